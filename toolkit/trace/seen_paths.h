// Paths over what shows of a model from one side. Internal to trace.
#pragma once

#include <string>
#include <vector>

#include "toolkit/core/result.h"
#include "toolkit/trace/path_shapes.h"
#include "toolkit/trace/seen_surface.h"

namespace palpate::trace {

/// The HIP along the curve, relative to the cloud's origin: at constant speed along the surface, standing off
/// it along the normal. Towards every end of the surface (a border, a hole, a step to a sheet above or below)
/// it rises, a millimetre in a millimetre, until it is at the clearance there; crosses to where the surface
/// goes on, above everything that shows on the way; and goes down again.
[[nodiscard]] Result<std::vector<Vec3>> follow(const SeenSurface& seen, const Curve& curve,
                                               const Timing& timing);

/// The surface at (u, v), or at the nearest place of a lattice where some shows.
struct SeenPoint {
  geometry::SurfacePoint surface;
  double u = 0.0, v = 0.0;
};
[[nodiscard]] Result<SeenPoint> nearest_seen(const SeenSurface& seen, double u, double v);

/// From a place along u at one depth to the end of the surface, on beyond it as far as nothing stands in the
/// way, and back above.
[[nodiscard]] Result<std::vector<Vec3>> slide_over(const SeenSurface& seen, const SeenPoint& start,
                                                   const Timing& timing);

}  // namespace palpate::trace
