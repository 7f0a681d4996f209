// Paths and traces as Python holds them.
#include <fmt/format.h>

#include <cmath>

#include "device/record/recording.h"
#include "experiments/live/recording_session.h"
#include "experiments/python/scene_object.h"

namespace palpate::python {
namespace {

Path path_from_array(py::handle given, double rate_hz, ScenePtr scene) {
  const auto rows = rows_of_three(given, "places of the HIP");
  const std::span<const Vec3> hips_mm = vectors_of(rows);
  auto path = std::make_shared<trace::ProbePath>();
  path->name = "array";
  path->t_s = times_at(rate_hz, hips_mm.size());
  path->hip_mm.assign(hips_mm.begin(), hips_mm.end());
  return {std::move(path), std::move(scene)};
}

py::tuple pair_of(trace::PathAndTrace&& read) {
  return py::make_tuple(Path{std::make_shared<const trace::ProbePath>(std::move(read.path)), nullptr},
                        Trace{std::make_shared<const trace::ForceTrace>(std::move(read.trace))});
}

/// A recorded session's path and what one renderer answered in it.
py::tuple read_recording(const py::object& file, const std::string& renderer, bool skip_damaged) {
  return pair_of(without_lock([name = py::str(file).cast<std::string>(), &renderer,
                               skip_damaged](Progress&) -> Result<trace::PathAndTrace> {
    PALPATE_ASSIGN(device::Recording recording, device::Recording::open(name, {skip_damaged}));
    Result<trace::PathAndTrace> frames = experiments::frames_of_recording(recording, renderer);
    if (!frames) return std::move(frames).error().in_file(name);
    frames->path.name = name;
    frames->trace.label = renderer;
    return frames;
  }));
}

py::tuple read_trace(const py::object& file) {
  return pair_of(without_lock(
      [name = py::str(file).cast<std::string>()](Progress&) { return trace::read_trace_csv(name); }));
}

/// Data from which another process makes the same object.
py::tuple copies_of(const py::object& self, std::initializer_list<const char*> members) {
  py::list all;
  for (const char* const member : members) {
    const py::object value = self.attr(member);
    all.append(py::hasattr(value, "copy") ? value.attr("copy")() : value);
  }
  return py::tuple(all);
}

template <class T>
std::vector<T> values_of(const py::object& given) {
  const auto array = given.cast<py::array_t<T, py::array::c_style>>();
  return {array.data(), array.data() + array.size()};
}

void check_counts(const py::tuple& columns, std::size_t first, std::size_t count) {
  for (std::size_t i = first; i < columns.size(); ++i)
    if (py::len(columns[i]) != count) raise({"the columns of a pickle differ in length", "pickle it anew"});
}

Path path_from_state(const py::tuple& state) {
  const py::array_t<double, py::array::c_style> rows = rows_of_three(state[2], "places of the HIP");
  const std::span<const Vec3> hips_mm = vectors_of(rows);
  check_counts(state, 1, hips_mm.size());
  return {std::make_shared<const trace::ProbePath>(trace::ProbePath{
              state[0].cast<std::string>(), values_of<double>(state[1]), {hips_mm.begin(), hips_mm.end()}}),
          nullptr};
}

constexpr std::initializer_list<const char*> kTraceMembers = {
    "label", "seconds", "frame_ns", "force_n", "god_object_mm", "contact", "model", "status"};

Trace trace_from_state(const py::tuple& state) {
  const auto forces = rows_of_three(state[3], "forces"), places = rows_of_three(state[4], "god objects");
  const auto contact = state[5].cast<py::array_t<bool>>();
  const auto model = state[6].cast<py::array_t<std::int32_t>>();
  const auto status = state[7].cast<py::array_t<std::uint8_t>>();
  auto trace = std::make_shared<trace::ForceTrace>();
  trace->label = state[0].cast<std::string>();
  trace->frame_ns = values_of<std::int64_t>(state[2]);
  trace->frames.resize(vectors_of(forces).size());
  check_counts(state, trace->frame_ns.empty() ? 3 : 2, trace->frames.size());
  for (std::size_t i = 0; i < trace->frames.size(); ++i) {
    const auto at = static_cast<py::ssize_t>(i);
    trace->frames[i] = {vectors_of(forces)[i], vectors_of(places)[i], contact.at(at), model.at(at),
                        static_cast<render::FrameStatus>(status.at(at))};
  }
  return {std::move(trace), state[1].cast<double>()};
}

}  // namespace

std::vector<double> times_at(double rate_hz, std::size_t count) {
  if (!(rate_hz > 0.0) || !std::isfinite(rate_hz)) raise({"the rate is not above 0", "give it in Hz"});
  std::vector<double> t_s(count);
  for (std::size_t i = 0; i < count; ++i) t_s[i] = static_cast<double>(i) / rate_hz;
  return t_s;
}

void add_paths(py::module_& module) {
  py::class_<Path>(module, "Path",
                   "Places of the HIP over time: hip_mm, (n, 3), world frame; t_s.\n\nwrite(file): as CSV.")
      .def_property_readonly("hip_mm",
                             [](const py::object& self) {
                               const auto& hips = self.cast<const Path&>().path->hip_mm;
                               return member_view<double>(hips, hips.data(), 3, self);
                             })
      .def_property_readonly("t_s",
                             [](const py::object& self) {
                               const auto& times = self.cast<const Path&>().path->t_s;
                               return member_view<double>(times, times.data(), 1, self);
                             })
      .def_property_readonly("name", [](const Path& self) { return self.path->name; })
      .def_property_readonly("scene",
                             [](const Path& self) { return std::const_pointer_cast<Scene>(self.scene); })
      .def(py::pickle(
          [](const py::object& self) {
            return copies_of(self, {"name", "t_s", "hip_mm"});
          },
          &path_from_state))
      .def("__len__", [](const Path& self) { return self.path->size(); })
      .def("write",
           [](const Path& self, const py::object& file) {
             check(trace::write_path_csv(*self.path, py::str(file).cast<std::string>()));
           })
      .def("__repr__", [](const Path& self) {
        return fmt::format("<palpate.Path {}, {} samples>", self.path->name, self.path->size());
      });

  py::class_<Trace> trace(
      module, "Trace",
      "The answers of a renderer, one frame for each sample of a path.\n\n"
      "force_n, god_object_mm: (n, 3), N and mm, world frame. contact. model: -1 when free.\n"
      "status: 0 ok, 1 bound-hit, 2 non-finite. frame_ns: ns, empty where untimed.\n"
      "seconds: that a replay took. hash: of all answers. write(path, file): as CSV.");
  const auto member = [&]<class T>(const char* name, T, py::ssize_t width, auto get) {
    trace.def_property_readonly(name, [width, get](const py::object& self) {
      const auto& frames = self.cast<const Trace&>().trace->frames;
      return member_view<T>(frames, frames.empty() ? nullptr : get(frames.front()), width, self);
    });
  };
  using render::Frame;
  member("force_n", double{}, 3, [](const Frame& f) -> const void* { return f.force_n.data(); });
  member("god_object_mm", double{}, 3, [](const Frame& f) -> const void* { return f.god_object_mm.data(); });
  member("contact", bool{}, 1, [](const Frame& f) -> const void* { return &f.contact; });
  member("model", std::int32_t{}, 1, [](const Frame& f) -> const void* { return &f.model; });
  member("status", std::uint8_t{}, 1, [](const Frame& f) -> const void* { return &f.status; });
  trace
      .def_property_readonly("frame_ns",
                             [](const py::object& self) {
                               const auto& times = self.cast<const Trace&>().trace->frame_ns;
                               return member_view<std::int64_t>(times, times.data(), 1, self);
                             })
      .def_readonly("seconds", &Trace::seconds)
      .def(py::pickle([](const py::object& self) { return copies_of(self, kTraceMembers); },
                      &trace_from_state))
      .def_property_readonly("label", [](const Trace& self) { return self.trace->label; })
      .def_property_readonly("hash", [](const Trace& self) { return trace::trace_hash(*self.trace); })
      .def("__len__", [](const Trace& self) { return self.trace->frames.size(); })
      .def("write",
           [](const Trace& self, const Path& path, const py::object& file) {
             check(trace::write_trace_csv(*path.path, *self.trace, py::str(file).cast<std::string>()));
           })
      .def("__repr__", [](const Trace& self) {
        return fmt::format("<palpate.Trace {}, {} frames>", self.trace->label, self.trace->frames.size());
      });

  module.def(
      "path",
      [](const py::object& source, const py::object& scene, double rate_hz) {
        const ScenePtr of = scene.is_none() ? nullptr : scene_of(scene);
        if (py::isinstance<py::str>(source) || py::hasattr(source, "__fspath__"))
          return made_path(py::str(source).cast<std::string>(), of);
        return path_from_array(source, rate_hz, of);
      },
      py::arg("source"), py::arg("scene") = py::none(), py::arg("rate_hz") = kPathHz);
  module.def("read_recording", &read_recording, py::arg("file"), py::arg("renderer") = "",
             py::arg("skip_damaged") = false);
  module.def("read_trace", &read_trace, py::arg("file"));
}

Path path_of(py::handle given, double rate_hz, const ScenePtr& scene) {
  if (py::isinstance<Path>(given)) return given.cast<const Path&>();
  return path_from_array(given, rate_hz, scene);
}

}  // namespace palpate::python
