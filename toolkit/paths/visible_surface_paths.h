// Paths over the visible surface of a model. Internal to paths.
#pragma once

#include <string>
#include <vector>

#include <palpate/result.h>
#include "toolkit/paths/path_shapes.h"
#include "toolkit/paths/visible_surface.h"

namespace palpate::paths {

/// The HIP along the curve, relative to the cloud's origin: constant speed along the surface, offset along
/// the normal. Towards each end of the surface (border, hole, step to another sheet) it rises at 45 degrees
/// to the clearance, crosses to where the surface continues above everything visible, and descends.
[[nodiscard]] Result<std::vector<Vec3>> follow(const VisibleSurface& seen, const Curve& curve,
                                               const PathTiming& timing);

/// The surface at (u, v), or at the nearest lattice place that shows some.
struct VisiblePoint {
  geometry::SurfacePoint surface;
  double u = 0.0, v = 0.0;
};
[[nodiscard]] Result<VisiblePoint> nearest_visible(const VisibleSurface& seen, double u, double v);

/// From a place along u at one depth to the end of the surface, beyond it while nothing is in the way, and
/// back above.
[[nodiscard]] Result<std::vector<Vec3>> slide_over(const VisibleSurface& seen, const VisiblePoint& start,
                                                   const PathTiming& timing);

}  // namespace palpate::paths
