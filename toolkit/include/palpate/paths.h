// Generators of probe paths. On a model with a formula, all but `exploration` and `hand` follow the formula,
// so the path does not depend on the sampling. On other models they follow the surface visible from one side:
// the file's faces, or planes fitted to the points. Deterministic: one spec and target give the same bits.
//
// First:
//   palpate::paths::PathTarget target;
//   target.surface = scene.models[0].analytic.get();
//   target.box_mm = scene.models[0].cloud->box_mm();
//   auto path = palpate::paths::make_path({"weave", {}}, target);
//   if (!path) return failed(path.error());
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/analytic_surface.h>
#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/options.h>
#include <palpate/result.h>
#include <palpate/trace.h>

namespace palpate::paths {

/// The force (N, world) felt along a moving HIP (mm, world), which starts in free space. Calls are at most
/// one millisecond apart.
using ForceFunction = std::function<Vec3(const Vec3& hip_mm)>;

/// The model that a path is made for, in the model frame except world_from_model. Owns nothing.
struct PathTarget {
  const geometry::AnalyticSurface* surface = nullptr;  ///< the formula, or null
  const cloud::Cloud* cloud = nullptr;                 ///< needed by exploration and by models without a
                                                       ///< formula
  const geometry::TriangleMesh* mesh = nullptr;  ///< faces whose orientation tells where outside is, or null
  geometry::Aabb box_mm;                         ///< box of the cloud
  double spacing_mm = 0.0;                       ///< median neighbour distance; 0 = unknown
  geometry::RigidTransform world_from_model;
  /// Makes the force function that a hand feels; called once, only by `hand`. Empty: nothing is felt.
  std::function<Result<ForceFunction>()> felt{};
  double stiffness_n_per_mm = 0.0;  ///< stiffness of what is felt
};

struct PathGenerator {
  std::string name;
  std::string summary;
  std::string models;   ///< what the generator follows, by kind of model
  std::string example;  ///< an example spec
  std::vector<OptionSpec> options;
};

/// weave, raster, spiral, strokes, tap, slide, hold, exploration, hand.
[[nodiscard]] const std::vector<PathGenerator>& path_generators();
[[nodiscard]] const PathGenerator* find_path_generator(std::string_view name);

/// Makes the path: `frames` HIP positions in the world frame at `rate_hz`, the first in free space. The
/// path's name is the spec with every option. O(frames), plus O(points log points) where points are read.
[[nodiscard]] Result<trace::ProbePath> make_path(const NamedOptions& spec, const PathTarget& target);

/// An Error naming the first sample (line 2 of `path.name` as a CSV file) if it lies inside the surface.
[[nodiscard]] Status check_path_starts_free(const trace::ProbePath& path,
                                            const geometry::AnalyticSurface& surface,
                                            const geometry::RigidTransform& world_from_model);

}  // namespace palpate::paths
