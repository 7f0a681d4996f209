// A prepared renderer as Python holds it.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include <palpate/renderer.h>
#include "experiments/python/python_renderer.h"
#include "experiments/python/scene_object.h"

namespace palpate::python {

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
