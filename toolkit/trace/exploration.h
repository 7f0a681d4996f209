// The path generator for clouds without a formula; see paths.h. Internal to trace.
#pragma once

#include "toolkit/core/random.h"
#include "toolkit/trace/paths.h"
#include "toolkit/trace/point_fits.h"

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

/// Where a path over points may begin, relative to the cloud's origin: a place of the surface that is the
/// outermost along a direction in which outside is certain (upwards for height fields, towards the open side
/// of an open mesh, a random one for closed ones), and a HIP above it that is clear of every point.
struct Beginning {
  Vec3 on_surface, normal, outward, hip;
};
[[nodiscard]] Result<Beginning> begin_outside(const PathTarget& target, const Fitting& fitting,
                                              double clearance_mm, Random& random);

/// HIP positions in the model frame.
///
/// A point walks over the cloud along a slowly turning heading: after each step it is put onto the plane
/// fitted to the points around it (weights falling smoothly to zero), the normal keeping its side; where
/// points end it turns. The HIP stands off it along the normal between clearance and -depth and never moves
/// faster than fastest_mm_s.
[[nodiscard]] Result<std::vector<Vec3>> explore(const PathTarget& target, const ExplorationOptions& options);

}  // namespace palpate::trace
