// The path generator for clouds without a formula (palpate/paths.h). Internal to paths.
#pragma once

#include <palpate/paths.h>
#include "toolkit/core/random.h"
#include "toolkit/paths/plane_fits.h"

namespace palpate::paths {

/// Options of `exploration`, validated.
struct ExplorationOptions {
  std::size_t frames = 0;
  double rate_hz = 0.0;
  double slowest_mm_s = 0.0, fastest_mm_s = 0.0;
  double depth_mm = 0.0, clearance_mm = 0.0;
  double period_frames = 0.0;
  std::uint64_t seed = 0;
};

/// The start of a path over points, relative to the cloud's origin: the outermost surface place in a
/// direction that is certainly outside (up for height fields, the open side of an open mesh, random for
/// closed ones), and a HIP above it clear of all points.
struct PathStart {
  Vec3 on_surface, normal, outward, hip;
};
[[nodiscard]] Result<PathStart> find_start_outside(const PathTarget& target, const FitSearch& fitting,
                                                   double clearance_mm, Random& random);

/// HIP positions in the model frame.
/// A point walks over the cloud along a slowly turning heading. After each step it is projected to the plane
/// fitted to the points around (smooth weights), keeping the normal's side; where points end it turns. The
/// HIP is offset along the normal between clearance and -depth, at most at fastest_mm_s.
[[nodiscard]] Result<std::vector<Vec3>> explore(const PathTarget& target, const ExplorationOptions& options);

}  // namespace palpate::paths
