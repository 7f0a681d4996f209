// Clouds, scenes, paths and traces as Python holds them.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include <palpate/scene.h>
#include <palpate/trace.h>
#include "experiments/python/convert.h"
#include "experiments/session/session.h"

namespace palpate::python {

/// A loaded scene, shared by what is made of it.
struct Scene {
  std::string name;
  scene::LoadedScene loaded;
  std::optional<NamedOptions> renderer{};  ///< the scene file's own
  bool from_columns = false;               ///< arrays of Python look at the points, and may have changed them
  /// A replay without the interpreter's lock moves the models: nobody else may. Read and written with the
  /// lock. Scenes that differ in their surfaces alone share the models' motion, and this.
  std::shared_ptr<bool> moving = std::make_shared<bool>(false);
  /// Options with which `name` was read; empty where the scene was changed since: another process cannot make
  /// it then.
  std::optional<experiments::ModelArguments> read_by{};
};
using ScenePtr = std::shared_ptr<const Scene>;

/// A replay that moves the scene's models, as long as it lives. With the lock.
class PALPATE_HIDDEN MovesModels {
 public:
  explicit MovesModels(const Scene& scene) : moving_(*scene.moving) {
    moving_ = scene.loaded.input.simulation != nullptr;
  }
  ~MovesModels() { moving_ = false; }
  MovesModels(const MovesModels&) = delete;
  MovesModels& operator=(const MovesModels&) = delete;

 private:
  bool& moving_;
};

/// One model of a scene.
struct Cloud {
  ScenePtr scene;
  std::size_t model = 0;

  [[nodiscard]] const render::ModelInput& input() const { return scene->loaded.input.models[model]; }
  [[nodiscard]] const std::shared_ptr<const cloud::Cloud>& points() const { return input().cloud; }
};

/// A path, and the scene that it was made for.
struct Path {
  std::shared_ptr<const trace::ProbePath> path;
  ScenePtr scene;  ///< or null
};

/// Answers of a renderer along a path.
struct Trace {
  std::shared_ptr<const trace::ForceTrace> trace;
  double seconds = 0.0;  ///< that its frames took, all together; 0: not replayed here
};

/// Default rate of paths that come without times.
inline constexpr double kPathHz = 1000.0;

/// The scene of a Scene, a Cloud, a file's name, a generator with options, or an (n, 3) array in mm.
[[nodiscard]] ScenePtr scene_of(py::handle given);
/// `scene` with uniform stiffness (N/mm), friction (one or a pair), deformation, and a force limit (N). Takes
/// these keys out of `given`; the same scene where there are none.
[[nodiscard]] ScenePtr with_surface(const ScenePtr& scene, py::dict& given);

/// Throws if somebody has changed points that Python's arrays look at.
void check_unchanged(const Scene& scene);

/// The times of `count` samples from 0.
[[nodiscard]] std::vector<double> times_at(double rate_hz, std::size_t count);

/// A file's path, or one that a generator makes for the scene.
[[nodiscard]] Path made_path(const std::string& text, const ScenePtr& scene);
/// A Path, or an (n, 3) array at this rate.
[[nodiscard]] Path path_of(py::handle given, double rate_hz, const ScenePtr& scene);

void add_scenes(py::module_& module);
void add_paths(py::module_& module);
/// Truths, scores and comparisons.
void add_comparison(py::module_& module);

}  // namespace palpate::python
