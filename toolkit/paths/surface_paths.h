// Paths over a model without a formula: along its visible surface, and exploring its points
// (palpate/paths.h). Internal to paths.
#pragma once

#include <string>
#include <vector>

#include <palpate/paths.h>
#include <palpate/result.h>
#include "toolkit/core/random.h"
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
[[nodiscard]] Result<std::vector<Vec3>> explore(const PathTarget& target, const PathTiming& timing,
                                                double slowest_mm_s, double fastest_mm_s);

}  // namespace palpate::paths
