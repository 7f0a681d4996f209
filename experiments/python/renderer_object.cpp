#include "experiments/python/renderer_object.h"

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>

#include <palpate/control.h>
#include <palpate/replay.h>
#include "experiments/session/session.h"

namespace palpate::python {
namespace {

constexpr double kStepS = 1e-3;  // of the classic haptic loop

render::Simulation* simulation_of(const Scene& scene) {
  return scene.loaded.input.simulation.get();
}

}  // namespace

/// The renderer while somebody uses it.
class Renderer::Use {
 public:
  explicit Use(Renderer& renderer) : renderer_(renderer) {
    if (renderer.closed()) raise({"the renderer is closed", "make another one"});
    if (renderer.in_use_)
      raise({"the renderer is at work for another caller", "give each thread a renderer of its own"});
    if (*renderer.scene_->moving)
      raise({"a replay in another thread moves the scene's models", "load the scene once for each thread"});
    renderer.in_use_ = true;
  }
  ~Use() { renderer_.in_use_ = false; }
  Use(const Use&) = delete;
  Use& operator=(const Use&) = delete;

 private:
  Renderer& renderer_;
};

Renderer::Renderer(ScenePtr scene, std::string name, Options options, PythonClassPtr python, int threads)
    : scene_(std::move(scene)),
      name_(std::move(name)),
      options_(std::move(options)),
      python_(std::move(python)) {
  check_unchanged(*scene_);
  render::Registry registry = our_renderers();
  if (python_ != nullptr) add_python_renderer(registry, python_, scene_);
  renderer_ = value_of(registry.make(name_, options_));
  check(registry.check_supports(*registry.find(name_), scene_->loaded.input));
  if (scene_->loaded.control.any()) renderer_ = control::wrap(std::move(renderer_), scene_->loaded.control);
  if (python_ != nullptr) python_->forget_failure();
  try {
    report_ = without_lock([&](Progress& progress) {
      return renderer_->prepare(scene_->loaded.input, {.threads = threads, .progress = &progress});
    });
  } catch (py::error_already_set&) {
    raise_failure();  // with the place in Python
    throw;
  }
}

void Renderer::raise_failure() {
  if (python_ != nullptr && python_->failure()) raise(*python_->failure());
}

void Renderer::restart_at(const Vec3& hip_mm, double t_s) {
  if (!is_finite(hip_mm)) raise({"the first place of the HIP is not finite", "begin in free space"});
  if (render::Simulation* const simulation = simulation_of(*scene_)) {
    simulation->reset();
    simulation->advance(t_s);
  }
  if (python_ != nullptr) python_->forget_failure();
  renderer_->restart(hip_mm, t_s);
  last_s_ = t_s;
}

void Renderer::restart(py::handle hip, double t_s) {
  const Use use(*this);
  if (!std::isfinite(t_s)) raise({"the time is not finite", "give seconds"});
  restart_at(vec3_of(hip), t_s);
  raise_failure();
}

py::object Renderer::step(py::handle hip, py::handle t_s) {
  const Use use(*this);
  const Vec3 hip_mm = vec3_of(hip);
  const double now_s = t_s.is_none() ? last_s_.value_or(-kStepS) + kStepS : number_of(t_s, "the time");
  if (!last_s_) restart_at(hip_mm, now_s - kStepS);
  if (!(now_s > *last_s_))
    raise({fmt::format("time does not increase: {} s after {} s", now_s, *last_s_), "restart to go back"});
  if (render::Simulation* const simulation = simulation_of(*scene_)) simulation->advance(now_s);
  last_s_ = now_s;
  const render::Frame frame = renderer_->step(hip_mm, now_s);
  raise_failure();
  return frame_object(frame);
}

Trace Renderer::replay(py::handle path, double rate_hz) {
  const Use use(*this);
  // An array is read where it lies; `rows` and `given` keep the samples.
  Path given;
  py::array_t<double, py::array::c_style> rows;
  std::vector<double> t_s;
  const trace::PathView samples = [&]() -> trace::PathView {
    if (py::isinstance<Path>(path)) {
      given = path.cast<const Path&>();
      return *given.path;
    }
    rows = rows_of_three(path, "places of the HIP");
    t_s = times_at(rate_hz, static_cast<std::size_t>(rows.shape(0)));
    return {"array", t_s, vectors_of(rows)};
  }();
  if (!samples.hip_mm.empty() && !is_finite(samples.hip_mm.front()))
    raise({"the first place of the HIP is not finite", "begin in free space"});
  if (python_ != nullptr) python_->forget_failure();
  render::Simulation* const simulation = simulation_of(*scene_);
  double seconds = 0.0;
  Result<trace::ForceTrace> replayed = [&] {
    const MovesModels moves(*scene_);
    const Unlocked unlocked;
    const Stopwatch watch;
    Result<trace::ForceTrace> frames = trace::replay(*renderer_, samples, simulation);
    constexpr double kSPerMs = 1e-3;
    seconds = kSPerMs * watch.ms();
    return frames;
  }();
  last_s_.reset();
  raise_failure();
  return {std::make_shared<const trace::ForceTrace>(value_of(std::move(replayed))), seconds};
}

void Renderer::close() {
  if (closed()) return;
  const Use use(*this);
  renderer_.reset();
}

py::dict Renderer::counters() {
  const Use use(*this);
  const render::FrameCounters counted = renderer_->counters();
  py::dict all;
  all["frames"] = counted.frames;
  all["bound_hits"] = counted.bound_hits;
  all["walk_steps"] = counted.walk_steps;
  all["late_frames"] = counted.late_frames;
  all["coarse_frames"] = counted.coarse_frames;
  all["damaged_tiles"] = counted.damaged_tiles;
  return all;
}

void add_renderer(py::module_& module) {
  py::class_<Renderer>(
      module, "Renderer",
      "A prepared renderer: places of the HIP in, forces out. One caller at a time.\n\n"
      "step(hip, t_s=None): a Frame; hip: mm, world frame; t_s: s, None: 1 ms after the last.\n"
      "replay(path, rate_hz=1000): a Trace; a Path, or an (n, 3) array in mm; other threads run meanwhile.\n"
      "restart(hip, t_s=0): begins anew with the HIP free at hip. close(): frees what it holds.\n"
      "prepare_ms, bytes, notes, warnings: of its preparation. counters(): sums since the last restart.")
      .def("step", &Renderer::step, py::arg("hip"), py::arg("t_s") = py::none())
      .def("replay", &Renderer::replay, py::arg("path"), py::arg("rate_hz") = kPathHz)
      .def("restart", &Renderer::restart, py::arg("hip"), py::arg("t_s") = 0.0)
      .def("close", &Renderer::close)
      .def_property_readonly("closed", &Renderer::closed)
      .def_property_readonly("name", &Renderer::name)
      .def_property_readonly(
          "scene", [](const Renderer& self) { return std::const_pointer_cast<Scene>(self.scene()); })
      .def_property_readonly("options",
                             [](const Renderer& self) {
                               py::dict all;
                               for (const auto& [key, value] : self.options().all())
                                 all[py::str(key)] = value;
                               return all;
                             })
      .def_property_readonly("prepare_ms", [](const Renderer& self) { return self.report().total_ms; })
      .def_property_readonly("bytes", [](const Renderer& self) { return self.report().bytes; })
      .def_property_readonly("notes", [](const Renderer& self) { return self.report().notes; })
      .def_property_readonly("warnings", [](const Renderer& self) { return self.report().warnings; })
      .def("counters", &Renderer::counters)
      .def("__enter__", [](const py::object& self) { return self; })
      .def("__exit__", [](Renderer& self, const py::args&) { self.close(); })
      .def("__repr__", [](const Renderer& self) {
        return fmt::format("<palpate.Renderer {} on {}{}>", self.name(), self.scene()->name,
                           self.closed() ? ", closed" : "");
      });

  module.def(
      "renderer",
      [](const py::object& name, const py::object& source, int threads, const py::kwargs& options) {
        py::dict rest(**options);
        const ScenePtr scene = with_surface(scene_of(source), rest);
        if (py::isinstance<py::str>(name))
          return std::make_unique<Renderer>(scene, name.cast<std::string>(), options_of(rest), nullptr,
                                            threads);
        auto python = std::make_shared<PythonClass>(name);
        if (rest.size() > 0)
          raise({"a renderer written in Python takes no options", "give them to its class"});
        return std::make_unique<Renderer>(scene, python->name(), Options(), python, threads);
      },
      py::arg("name"), py::arg("scene"), py::kw_only(), py::arg("threads") = 0);
  module.def("renderers", [] {
    py::dict all;
    for (const render::RendererInfo& info : our_renderers().all()) {
      py::dict options;
      for (const OptionSpec& option : info.options)
        options[py::str(option.key)] = py::make_tuple(option.default_value, option.help);
      py::dict one;
      one["summary"] = info.summary;
      one["source"] = info.source;
      one["role"] = std::string(render::name_of(info.role));
      one["options"] = options;
      all[py::str(info.name)] = one;
    }
    return all;
  });
}

namespace {

// Above it a double no longer counts one by one.
constexpr double kMostCountedBytes = 0x1p53;

using render::Frame;
using render::FrameStatus;

/// Hands each frame to the Python object. After its first exception it answers no force.
class PALPATE_HIDDEN PythonRenderer final : public render::HapticRenderer {
 public:
  PythonRenderer(PythonClassPtr python, ScenePtr scene)
      : python_(std::move(python)), scene_(std::move(scene)) {}
  ~PythonRenderer() override {
    const py::gil_scoped_acquire lock;
    object_ = py::object();
    step_ = py::object();
  }

  [[nodiscard]] Result<render::Decisions> decide(const render::SceneInput& scene,
                                                 const render::PrepareContext& /*context*/) const override {
    render::Decisions decided;
    for (const render::ModelInput& model : scene.models) {
      render::ModelDecisions& one = decided.models.emplace_back();
      one.name = model.name;
      one.points = model.cloud->size();
    }
    return decided;
  }

  [[nodiscard]] Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                                      const render::PrepareContext& context) override {
    const Stopwatch watch;
    render::PrepareReport report;
    PALPATE_ASSIGN(report.decisions, decide(scene, context));
    stiffness_n_per_mm_ = scene.models.front().surface.stiffness_n_per_mm;
    force_limit_n_ = scene.force_limit_n;
    const py::gil_scoped_acquire lock;
    try {
      object_ = python_->make();
      object_.attr("prepare")(std::const_pointer_cast<Scene>(scene_));
      step_ = object_.attr("step");
      if (py::hasattr(object_, "bytes"))
        report.bytes = static_cast<std::uint64_t>(
            std::clamp(number_of(object_.attr("bytes"), "bytes"), 0.0, kMostCountedBytes));
    } catch (py::error_already_set& exception) {
      python_->fail(error_of(exception));
      Error error = *python_->failure();
      // A place in a file is that of a result in comparisons.
      error.what = fmt::format("{} ({}:{})", error.what, error.file, error.line);
      error.file.clear();
      error.line = 0;
      return error;
    }
    report.total_ms = watch.ms();
    report.phases = {{"prepare", report.total_ms}};
    return report;
  }

  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    counters_ = {};
    call("restart", hip_mm, t_s);
  }
  void release_contact(const Vec3& hip_mm) noexcept override { call("restart", hip_mm, 0.0); }

  [[nodiscard]] Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    ++counters_.frames;
    Frame frame;
    frame.god_object_mm = hip_mm;
    if (!is_finite(hip_mm) || python_->failure()) {
      frame.status = FrameStatus::kNonFinite;
      return frame;
    }
    const py::gil_scoped_acquire lock;
    try {
      answer(step_(tuple_of(hip_mm), t_s), frame);
    } catch (py::error_already_set& exception) {
      fail(exception, frame, hip_mm);
    } catch (const std::exception& exception) {
      python_->fail({exception.what(), "mend the renderer's class"});
    }
    return frame;
  }

  [[nodiscard]] render::FrameCounters counters() const noexcept override { return counters_; }
  [[nodiscard]] render::Description describe() const override {
    return {python_->name(), "a renderer written in Python", "", "unbounded: Python", {}};
  }

 private:
  /// None, a force, or (force, god object).
  void answer(const py::object& given, Frame& frame) const {
    if (given.is_none()) return;
    const Vec3 hip_mm = frame.god_object_mm;
    const bool both = (PyTuple_Check(given.ptr()) != 0 || PyList_Check(given.ptr()) != 0) &&
                      PySequence_Size(given.ptr()) == 2;
    const Vec3 force_n = vec3_of(both ? py::object(given[py::int_(0)]) : given);
    if (!is_finite(force_n)) raise({"the force is not finite", "answer None where there is none"});
    frame.contact = !force_n.isZero(0.0);
    frame.model = frame.contact ? 0 : -1;
    frame.force_n = render::limited(force_n, force_limit_n_);
    // Without a god object of its own: that of the spring which would push so.
    frame.god_object_mm = both ? vec3_of(given[py::int_(1)]) : Vec3(hip_mm + force_n / stiffness_n_per_mm_);
    if (!is_finite(frame.god_object_mm)) raise({"the god object is not finite", "answer the force alone"});
    if (!frame.contact) frame.god_object_mm = hip_mm;
  }

  void fail(py::error_already_set& exception, Frame& frame, const Vec3& hip_mm) noexcept {
    try {
      python_->fail(error_of(exception));
    } catch (const std::exception&) {
      python_->fail({"the renderer's class failed", "mend it"});
    }
    frame = {};
    frame.god_object_mm = hip_mm;
    frame.status = FrameStatus::kNonFinite;
  }

  /// An optional method.
  void call(const char* method, const Vec3& hip_mm, double t_s) noexcept {
    const py::gil_scoped_acquire lock;
    Frame none;
    try {
      if (object_ && py::hasattr(object_, method)) object_.attr(method)(tuple_of(hip_mm), t_s);
    } catch (py::error_already_set& exception) {
      fail(exception, none, hip_mm);
    } catch (const std::exception&) {
      python_->fail({"the renderer's class failed", "mend it"});
    }
  }

  PythonClassPtr python_;
  ScenePtr scene_;
  py::object object_, step_;
  double stiffness_n_per_mm_ = 0.0, force_limit_n_ = 0.0;
  render::FrameCounters counters_;
};

}  // namespace

PythonClass::PythonClass(py::object given) : given_(std::move(given)) {
  for (const char* const method : {"prepare", "step"})
    if (!py::hasattr(given_, method) || PyCallable_Check(given_.attr(method).ptr()) == 0)
      raise({fmt::format("this is no renderer: it has no method '{}'", method),
             "give a name of palpate.renderers(), or a class with prepare(scene) and step(hip, t)"});
  is_class_ = PyType_Check(given_.ptr()) != 0;
  const py::object type = is_class_ ? given_ : py::type::of(given_);
  name_ =
      py::str(py::hasattr(given_, "name") ? given_.attr("name") : type.attr("__name__")).cast<std::string>();
}

PythonClass::~PythonClass() {
  const py::gil_scoped_acquire lock;
  given_ = py::object();
}

py::object PythonClass::make() const {
  return is_class_ ? given_() : given_;
}

const render::Registry& our_renderers() {
  static const render::Registry all = experiments::all_renderers();
  return all;
}

void add_python_renderer(render::Registry& registry, const PythonClassPtr& python, ScenePtr scene) {
  if (registry.find(python->name()) != nullptr)
    raise({fmt::format("the name '{}' is taken by another renderer", python->name()),
           "give one of them another, as an attribute: name = \"..\""});
  render::RendererInfo info;
  info.name = python->name();
  info.summary = "a renderer written in Python";
  info.role = render::Role::kRival;
  // Only its author knows the features that it leaves out.
  info.supports = render::kAllOfRigidSurfaces | render::Feature::kDent | render::Feature::kMovedPoints;
  info.make = [python, scene = std::move(scene)](const Options&) {
    return std::make_unique<PythonRenderer>(python, scene);
  };
  registry.add(std::move(info));
}

}  // namespace palpate::python
