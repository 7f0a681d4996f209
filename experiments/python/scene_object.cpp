#include "experiments/python/scene_object.h"

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <array>
#include <set>

#include "experiments/data/scans.h"
#include "experiments/run/arguments.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/spline_sdf/prepared_surface.h"

namespace palpate::python {
namespace {

namespace ex = palpate::experiments;

/// Names, units and numbers of read() and scene().
ex::ModelArguments model_arguments(const py::kwargs& given) {
  ex::ModelArguments arguments;
  for (const auto& [key, value] : given) {
    const auto name = key.cast<std::string>();
    if (name == "unit")
      arguments.unit = value.is_none() ? "" : py::str(value).cast<std::string>();
    else if (name == "non_finite")
      arguments.non_finite = py::str(value).cast<std::string>();
    else if (name == "scale")
      arguments.scale = number_of(value, "scale");
    else
      raise({fmt::format("'{}' is none of unit, scale and non_finite", name), "leave it out"});
  }
  if (given.contains("scale") && !(arguments.scale > 0.0)) raise({"scale is not above 0", "give a factor"});
  if (!arguments.non_finite.empty() && arguments.non_finite != "drop" && arguments.non_finite != "refuse")
    raise({"non_finite is neither drop nor refuse", "choose one of them"});
  return arguments;
}

ScenePtr load(const std::string& source, const ex::ModelArguments& arguments) {
  const scene::LoadOptions options = value_of(ex::load_options(arguments));
  return without_lock([&](Progress& progress) -> Result<ScenePtr> {
    PALPATE_ASSIGN(const scene::SceneFile file, ex::open_scene(source, ex::all_renderers(), progress));
    PALPATE_ASSIGN(scene::LoadedScene loaded, scene::load(file, ex::all_readers(), options, progress));
    auto made = std::make_shared<Scene>(Scene{source, std::move(loaded), file.renderer});
    made->read_by = arguments;
    return ScenePtr(std::move(made));
  });
}

std::string hash_of(const cloud::Cloud& points) {
  return fmt::format("{:016x}", cloud::content_hash(points));
}

/// A scene of one model with these points.
ScenePtr scene_around(std::shared_ptr<const cloud::Cloud> points, io::Unit unit, bool from_columns) {
  auto made = std::make_shared<Scene>();
  made->name = "array";
  made->from_columns = from_columns;
  made->read_by.emplace();
  scene::Provenance from;
  from.source = "array";
  from.format = "array";
  from.content_hash = hash_of(*points);
  from.unit = unit;
  from.file_points = points->size();
  render::ModelInput model;
  model.name = "array";
  model.cloud = std::move(points);
  made->loaded.input.models = {std::move(model)};
  made->loaded.provenance = {std::move(from)};
  made->loaded.sampled_mesh = {nullptr};
  return made;
}

ScenePtr scene_from_array(py::handle given, const std::string& unit_name, bool refuse) {
  const io::Unit unit = value_of(io::parse_unit(unit_name));
  const auto rows = rows_of_three(given, "points");
  std::vector<Vec3> scaled;
  std::span<const Vec3> points_mm = vectors_of(rows);
  if (const double mm = io::mm_per(unit); mm != 1.0) {
    scaled.assign(points_mm.begin(), points_mm.end());
    for (Vec3& p : scaled) p *= mm;
    points_mm = scaled;
  }
  Result<cloud::Cloud> built =
      cloud::build_cloud(points_mm, refuse ? cloud::NonFinite::kRefuse : cloud::NonFinite::kDrop);
  if (!built)
    raise({built.error().what, refuse ? "mend the array, or give drop_non_finite=True" : "mend the array"});
  auto points = std::make_shared<cloud::Cloud>(*std::move(built));
  return scene_around(std::move(points), unit, false);
}

/// A cloud's own columns before it is a cloud, to be filled from Python: the way in without a copy.
struct PALPATE_HIDDEN Columns {
  std::shared_ptr<cloud::Cloud> points = std::make_shared<cloud::Cloud>();  ///< null: a cloud has them
  py::array x, y, z;

  explicit Columns(std::size_t count) {
    using Owner = std::shared_ptr<cloud::Cloud>;
    for (auto [array, values] :
         {std::pair{&x, &points->x_mm}, std::pair{&y, &points->y_mm}, std::pair{&z, &points->z_mm}}) {
      values->resize(count);
      const py::capsule owner(new Owner(points), [](void* held) { delete static_cast<Owner*>(held); });
      *array = py::array_t<float>(static_cast<py::ssize_t>(count), values->data(), owner);
    }
  }
};

/// The columns become a cloud where they lie; their arrays can only be read from then on.
ScenePtr scene_from_columns(Columns& columns, py::handle origin) {
  if (columns.points == nullptr) raise({"these columns are a cloud already", "make others"});
  const std::shared_ptr<cloud::Cloud>& points = columns.points;
  points->origin_mm = vec3_of(origin);
  if (!is_finite(points->origin_mm)) raise({"the origin is not finite", "give it in mm"});
  for (std::size_t i = 0; i < points->size(); ++i)
    if (!is_finite(points->local_mm(i)))
      raise({fmt::format("point {} is not finite", i), "leave it out, or give palpate.cloud an array"});
  // A single's digits are spent on the distance to the origin: twice the extent leaves all but two bits.
  constexpr double kFarthestExtents = 2.0;
  const geometry::Aabb box = points->box_mm();
  if ((box.centre_mm() - points->origin_mm).norm() > kFarthestExtents * box.extent_mm().norm())
    raise({"the points lie far from their origin, where single precision is coarse",
           "subtract their middle and give it as origin_mm"});
  for (py::array* const array : {&columns.x, &columns.y, &columns.z})
    array->attr("flags").attr("writeable") = false;
  return scene_around(std::exchange(columns.points, nullptr), io::Unit::kMillimetre, true);
}

py::array column(const std::vector<float>& values, py::handle self) {
  return member_view<float>(values, values.data(), 1, self);
}

py::array_t<double> all_points(const Cloud& cloud) {
  const cloud::Cloud& points = *cloud.points();
  py::array_t<double> rows({static_cast<py::ssize_t>(points.size()), py::ssize_t{3}});
  double* out = rows.mutable_data();
  for (std::size_t i = 0; i < points.size(); ++i)
    for (const double value : points.point_mm(i)) *out++ = value;
  return rows;
}

/// Data from which another process makes the same scene: the points of an array, or a source and how it was
/// read.
py::tuple state_of(const Scene& scene) {
  if (!scene.read_by)
    raise(
        {"a scene whose surface was changed cannot go to another process", "give the scene as it was read"});
  const ex::ModelArguments& by = *scene.read_by;
  const scene::Provenance& from = scene.loaded.provenance.front();
  if (from.format != "array") return py::make_tuple(scene.name, by.unit, by.scale, by.non_finite);
  check_unchanged(scene);
  const cloud::Cloud& points = *scene.loaded.input.models.front().cloud;
  const auto copy = [](const std::vector<float>& values) {
    return py::array_t<float>(static_cast<py::ssize_t>(values.size()), values.data());
  };
  return py::make_tuple(copy(points.x_mm), copy(points.y_mm), copy(points.z_mm), tuple_of(points.origin_mm),
                        std::string(io::unit_name(from.unit)));
}

ScenePtr scene_from_state(const py::tuple& state) {
  if (py::isinstance<py::str>(state[0])) {
    ex::ModelArguments by;
    by.unit = state[1].cast<std::string>();
    by.scale = state[2].cast<double>();
    by.non_finite = state[3].cast<std::string>();
    return load(state[0].cast<std::string>(), by);
  }
  auto points = std::make_shared<cloud::Cloud>();
  points->origin_mm = vec3_of(state[3]);
  std::size_t axis = 0;
  for (auto* values : {&points->x_mm, &points->y_mm, &points->z_mm}) {
    const auto column = state[axis++].cast<py::array_t<float>>();
    values->assign(column.data(), column.data() + column.size());
    if (values->size() != points->x_mm.size())
      raise({"the columns of a pickle differ in length", "pickle it anew"});
  }
  return scene_around(std::move(points), value_of(io::parse_unit(state[4].cast<std::string>())), false);
}

void prepare_file(const Cloud& cloud, const std::string& file, bool force) {
  if (cloud.input().prepared != nullptr)
    raise(
        {"is a prepared file already", "give the scan", cloud.scene->loaded.provenance[cloud.model].source});
  check(ex::check_output({file, {"palsurf"}, force}, {}));
  without_lock([&](Progress& progress) -> Status {
    render::PrepareReport report;
    return spline_sdf::prepare_surface_file(cloud.points(), {}, {0, &progress}, report, file);
  });
}

}  // namespace

ScenePtr scene_of(py::handle given) {
  if (py::isinstance<Cloud>(given)) {
    const auto& cloud = given.cast<const Cloud&>();
    const scene::LoadedScene& all = cloud.scene->loaded;
    if (all.input.models.size() == 1) return cloud.scene;
    auto alone = std::make_shared<Scene>(
        Scene{cloud.input().name, all, {}, cloud.scene->from_columns, cloud.scene->moving});
    alone->loaded.input.models = {cloud.input()};
    alone->loaded.provenance = {all.provenance[cloud.model]};
    alone->loaded.sampled_mesh = {all.sampled_mesh[cloud.model]};
    return alone;
  }
  if (py::isinstance<Scene>(given))
    return std::const_pointer_cast<const Scene>(given.cast<std::shared_ptr<Scene>>());
  if (py::isinstance<py::str>(given) || py::hasattr(given, "__fspath__"))
    return load(py::str(given).cast<std::string>(), {});
  return scene_from_array(given, "mm", true);
}

ScenePtr with_surface(const ScenePtr& scene, py::dict& given) {
  ex::SurfaceArguments wanted;
  const auto take = [&](const char* key) {
    std::string text;
    if (!given.contains(key)) return text;
    const py::object value = given[key];
    // One coefficient, or static and dynamic.
    if (PyTuple_Check(value.ptr()) != 0 || PyList_Check(value.ptr()) != 0)
      for (const py::handle part : value)
        text += (text.empty() ? "" : ",") + py::str(part).cast<std::string>();
    else
      text = py::str(value).cast<std::string>();
    given.attr("pop")(key);
    return text;
  };
  wanted.stiffness = take("stiffness");
  wanted.friction = take("friction");
  wanted.deformation = take("deformation");
  const std::string limit = take("force_limit");
  if (!wanted.any() && limit.empty()) return scene;
  auto changed = std::make_shared<Scene>(
      Scene{scene->name, scene->loaded, scene->renderer, scene->from_columns, scene->moving});
  if (!limit.empty()) changed->loaded.input.force_limit_n = value_of(read_number(limit, NumberRange{0.0}));
  for (render::ModelInput& model : changed->loaded.input.models) {
    if (wanted.any() && model.surface.per_point != nullptr)
      raise({fmt::format("the surface of '{}' differs from point to point", model.name),
             "leave stiffness, friction and deformation to the scene"});
    scene::SceneFile uniform;
    uniform.models.emplace_back().surface = model.surface;
    if (auto set = ex::set_surfaces(wanted, uniform); !set) {
      Error error = std::move(set).error();
      if (error.what.starts_with("--")) error.what.erase(0, 2);  // an option there, an argument here
      raise(error);
    }
    model.surface = uniform.models.front().surface;
  }
  return changed;
}

void check_unchanged(const Scene& scene) {
  if (!scene.from_columns) return;
  if (hash_of(*scene.loaded.input.models.front().cloud) != scene.loaded.provenance.front().content_hash)
    raise({"the points of this cloud were changed after it was made", "make another cloud"});
}

void add_scenes(py::module_& module) {
  py::class_<Scene, std::shared_ptr<Scene>>(module, "Scene", "Models with poses and surfaces.")
      .def_readonly("name", &Scene::name)
      .def_property_readonly("clouds",
                             [](const std::shared_ptr<Scene>& scene) {
                               py::list all;
                               for (std::size_t i = 0; i < scene->loaded.input.models.size(); ++i)
                                 all.append(Cloud{scene, i});
                               return py::tuple(all);
                             })
      .def_property_readonly("force_limit_n", [](const Scene& s) { return s.loaded.input.force_limit_n; })
      .def(py::pickle(
          &state_of,
          [](const py::tuple& state) { return std::const_pointer_cast<Scene>(scene_from_state(state)); }))
      .def("__repr__", [](const Scene& scene) {
        return fmt::format("<palpate.Scene {}, {} models>", scene.name, scene.loaded.input.models.size());
      });
  const auto from = [](const Cloud& cloud) -> const scene::Provenance& {
    return cloud.scene->loaded.provenance[cloud.model];
  };
  py::class_<Cloud> cloud(
      module, "Cloud",
      "The points of one model, and what is known of them.\n\n"
      "x, y, z: mm relative to origin_mm, views of its memory. points(): a new (n, 3) array in mm.\n"
      "box_mm: two corners, (2, 3). properties: further columns of the file. unit: of the source.\n"
      "copied: False where the points lie in the Columns that were filled.\n"
      "prepare(file, force=False): writes a prepared file (.palsurf) that read() opens.");
  const auto axis = [&](const char* name, std::vector<float> cloud::Cloud::*values) {
    cloud.def_property_readonly(name, [values](const py::object& self) {
      const auto& own = self.cast<const Cloud&>();
      return column((*own.points()).*values, self);
    });
  };
  axis("x", &cloud::Cloud::x_mm);
  axis("y", &cloud::Cloud::y_mm);
  axis("z", &cloud::Cloud::z_mm);
  cloud.def("__len__", [](const Cloud& self) { return self.points()->size(); })
      .def_property_readonly("origin_mm",
                             [](const Cloud& self) { return tuple_of(self.points()->origin_mm); })
      .def_property_readonly("box_mm",
                             [](const Cloud& self) {
                               const geometry::Aabb box = self.points()->box_mm();
                               const std::array corners{box.low_mm, box.high_mm};
                               return py::array_t<double>({2, 3}, corners.front().data());
                             })
      .def("points", &all_points)
      .def(py::pickle(
          [](const Cloud& self) {
            return py::make_tuple(std::const_pointer_cast<Scene>(self.scene), self.model);
          },
          [](const py::tuple& state) {
            return Cloud{state[0].cast<std::shared_ptr<Scene>>(), state[1].cast<std::size_t>()};
          }))
      .def_property_readonly("properties",
                             [](const py::object& self) {
                               py::dict all;
                               const auto& own = self.cast<const Cloud&>();
                               for (const cloud::Property& property : own.points()->properties)
                                 all[py::str(property.name)] = column(property.values, self);
                               return all;
                             })
      .def_property_readonly("name", [](const Cloud& self) { return self.input().name; })
      .def_property_readonly("source", [from](const Cloud& self) { return from(self).source; })
      .def_property_readonly("format", [from](const Cloud& self) { return from(self).format; })
      .def_property_readonly(
          "unit", [from](const Cloud& self) { return std::string(io::unit_name(from(self).unit)); })
      .def_property_readonly("copied", [](const Cloud& self) { return !self.scene->from_columns; })
      .def_property_readonly("warnings", [from](const Cloud& self) { return from(self).warnings; })
      .def_property_readonly("has_formula",
                             [](const Cloud& self) { return self.input().analytic != nullptr; })
      .def_property_readonly("has_faces",
                             [](const Cloud& self) { return self.input().original_mesh != nullptr; })
      .def_property_readonly("stiffness_n_per_mm",
                             [](const Cloud& self) { return self.input().surface.stiffness_n_per_mm; })
      .def("prepare", &prepare_file, py::arg("file"), py::arg("force") = false)
      .def("__repr__", [from](const Cloud& self) {
        return fmt::format("<palpate.Cloud {}, {} points>", from(self).source, self.points()->size());
      });

  module.def("scene", [](const py::object& source, const py::kwargs& given) {
    return std::const_pointer_cast<Scene>(load(py::str(source).cast<std::string>(), model_arguments(given)));
  });
  module.def("read", [](const py::object& source, const py::kwargs& given) {
    const ScenePtr scene = load(py::str(source).cast<std::string>(), model_arguments(given));
    if (scene->loaded.input.models.size() != 1)
      raise({fmt::format("the scene has {} models", scene->loaded.input.models.size()),
             "open it with palpate.scene", scene->name});
    return Cloud{scene, 0};
  });
  py::class_<Columns>(module, "Columns", "Room for the x, y and z of n points, mm, to be filled.")
      .def(py::init([](py::ssize_t count) {
             if (count < 1) raise({"a cloud has at least one point", "give their number"});
             if (static_cast<std::size_t>(count) > cloud::kMaxCloudPoints)
               raise({fmt::format("{} points are more than one model may have", count), "make several"});
             return std::make_unique<Columns>(static_cast<std::size_t>(count));
           }),
           py::arg("count"))
      .def_readonly("x", &Columns::x)
      .def_readonly("y", &Columns::y)
      .def_readonly("z", &Columns::z)
      .def(
          "cloud",
          [](Columns& self, const py::object& origin) {
            return Cloud{scene_from_columns(self, origin), 0};
          },
          py::arg("origin_mm") = py::make_tuple(0.0, 0.0, 0.0));
  module.def(
      "cloud",
      [](const py::object& points, const std::string& unit, bool drop_non_finite) {
        return Cloud{scene_from_array(points, unit, !drop_non_finite), 0};
      },
      py::arg("points"), py::kw_only(), py::arg("unit") = "mm", py::arg("drop_non_finite") = false);
}

}  // namespace palpate::python
