#include "experiments/python/python_renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "experiments/session/session.h"

namespace palpate::python {
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
