// A prepared renderer as Python holds it.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include <palpate/registry.h>
#include <palpate/renderer.h>
#include "experiments/python/convert.h"
#include "experiments/python/scene_object.h"

namespace palpate::python {

// A renderer written in Python, for the registry.

/// A Python object with `prepare(scene)` and `step(hip, t)`, or a class of such, and the first exception that
/// came out of it. `step` answers None (free), a force, or (force, god object). Methods of other threads wait
/// for the interpreter's lock.
class PALPATE_HIDDEN PythonClass {
 public:
  /// Throws where the methods are missing.
  explicit PythonClass(py::object given);
  ~PythonClass();
  PythonClass(const PythonClass&) = delete;
  PythonClass& operator=(const PythonClass&) = delete;

  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  /// An object to be prepared; with the lock.
  [[nodiscard]] py::object make() const;
  void fail(Error error) {
    if (!failure_) failure_ = std::move(error);
  }
  [[nodiscard]] const std::optional<Error>& failure() const noexcept { return failure_; }
  void forget_failure() noexcept { failure_.reset(); }

 private:
  py::object given_;
  bool is_class_ = false;
  std::string name_;
  std::optional<Error> failure_;
};
using PythonClassPtr = std::shared_ptr<PythonClass>;

/// Everything that Palpate registers; made once.
[[nodiscard]] const render::Registry& our_renderers();
/// Adds the class under its name; throws where the name is taken. `scene` is what its prepare() gets.
void add_python_renderer(render::Registry& registry, const PythonClassPtr& python, ScenePtr scene);

/// One caller at a time: a second one, or one that comes out of the renderer itself, gets an Error. The
/// interpreter's lock guards everything but the frames of replay().
class PALPATE_HIDDEN Renderer {
 public:
  /// Prepares it; throws.
  Renderer(ScenePtr scene, std::string name, Options options, PythonClassPtr python, int threads);

  /// One frame; `t_s` None: a millisecond after the last. The first one restarts the renderer there.
  [[nodiscard]] py::object step(py::handle hip, py::handle t_s);
  /// Restarts, then a frame for each sample; without the interpreter's lock.
  [[nodiscard]] Trace replay(py::handle path, double rate_hz);
  void restart(py::handle hip, double t_s);
  void close();

  [[nodiscard]] const ScenePtr& scene() const noexcept { return scene_; }
  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  [[nodiscard]] const Options& options() const noexcept { return options_; }
  [[nodiscard]] const PythonClassPtr& python() const noexcept { return python_; }
  [[nodiscard]] const render::PrepareReport& report() const noexcept { return report_; }
  [[nodiscard]] py::dict counters();
  [[nodiscard]] bool closed() const noexcept { return renderer_ == nullptr; }

 private:
  class Use;
  void restart_at(const Vec3& hip_mm, double t_s);
  void raise_failure();

  ScenePtr scene_;
  std::string name_;
  Options options_;  ///< as given
  PythonClassPtr python_;
  std::unique_ptr<render::HapticRenderer> renderer_;
  render::PrepareReport report_;
  bool in_use_ = false;
  std::optional<double> last_s_;  ///< empty: not restarted yet
};

void add_renderer(py::module_& module);

}  // namespace palpate::python
