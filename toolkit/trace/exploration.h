// The path generator for clouds without a formula; see paths.h. Internal to trace.
#pragma once

#include "toolkit/trace/paths.h"

namespace palpate::trace {

/// Options of `exploration`, validated.
struct ExplorationOptions {
  std::size_t frames = 0;
  double rate_hz = 0.0;
  double slowest_mm_s = 0.0, fastest_mm_s = 0.0;
  double depth_mm = 0.0, clearance_mm = 0.0;
  double period_frames = 0.0;
  std::uint64_t seed = 0;
};

/// HIP positions in the model frame.
///
/// A point walks over the cloud along a slowly turning heading: after each step it is put onto the plane
/// fitted to the points around it (weights falling smoothly to zero), the normal keeping its side; where
/// points end it turns. The HIP stands off it along the normal between clearance and -depth and never moves
/// faster than fastest_mm_s. The walk begins at the cloud's extreme point in some direction, where outside is
/// certain: upwards for height fields, towards the open side of an open mesh, a seeded direction for closed
/// ones.
[[nodiscard]] Result<std::vector<Vec3>> explore(const PathTarget& target, const ExplorationOptions& options);

}  // namespace palpate::trace
