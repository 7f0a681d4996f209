// Generators of probe paths. On a model with a formula all but `exploration` and `hand` follow the formula
// and never the points, so that every spacing of a surface is probed along one and the same path; on any
// other they follow what shows of it from one side, its own faces where it has any, else planes fitted to its
// points. Deterministic: one spec and target give the same path, bit for bit.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/geometry/analytic_surface.h"
#include "toolkit/geometry/rigid_transform.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/trace/trace.h"

namespace palpate::trace {

/// The force (N, world) that is felt where the HIP (mm, world) has gone; at the first place it is free. One
/// loop a millisecond or less apart.
using Feel = std::function<Vec3(const Vec3& hip_mm)>;

/// The model a path is made for; nothing is owned. Model frame but for world_from_model.
struct PathTarget {
  const geometry::AnalyticSurface* surface = nullptr;  ///< the formula, or null
  const cloud::Cloud* cloud = nullptr;                 ///< needed by exploration, and without a formula
  const geometry::TriangleMesh* mesh = nullptr;  ///< faces whose orientation tells where outside is, or null
  geometry::Aabb box_mm;                         ///< of the cloud
  double spacing_mm = 0.0;                       ///< median distance of neighbours; 0 = not known
  geometry::RigidTransform world_from_model;
  /// What a hand feels; asked for once, and only by `hand`. Empty: nothing is there.
  std::function<Result<Feel>()> felt{};
  double stiffness_n_per_mm = 0.0;  ///< of what is felt
};

struct PathGenerator {
  std::string name;
  std::string summary;
  std::string models;   ///< what it follows on which models
  std::string example;  ///< a spec
  std::vector<OptionSpec> options;
};

/// weave, raster, spiral, strokes, tap, slide, hold, exploration, hand.
[[nodiscard]] const std::vector<PathGenerator>& path_generators();
[[nodiscard]] const PathGenerator* find_path_generator(std::string_view name);

/// Makes the path: HIP positions in the world frame at `rate_hz`, `frames` of them, the first in free space.
/// The path's name is the spec with every option. O(frames), and O(points log points) where points are read.
[[nodiscard]] Result<ProbePath> make_path(const NamedOptions& spec, const PathTarget& target);

/// An Error that names the first sample (line 2 of `path.name` as a CSV file) where it lies inside the
/// surface.
[[nodiscard]] Status check_path_starts_free(const ProbePath& path, const geometry::AnalyticSurface& surface,
                                            const geometry::RigidTransform& world_from_model);

}  // namespace palpate::trace
