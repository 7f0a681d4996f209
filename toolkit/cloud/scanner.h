// A simulated scanner: rays from places around a surface, and what measuring does to the points that they
// hit.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/geometry/analytic_surface.h"

namespace palpate::cloud {

/// Lengths in spacings: the distance of neighbouring rays in the middle of the model.
struct ScannerOptions {
  double points = 0.0;  ///< wanted before dropout, of all views together
  int views = 1;        ///< places of the scanner
  double noise = 0.0;   ///< standard deviation of the range, along the ray
  double bias = 0.0;    ///< the range reads longer by this at 60 degrees of incidence, 0 at 0, as 1 / cos - 1
  double dropout = 0.0;       ///< share of the rays that return nothing
  double flying = 0.0;        ///< share of the points that hang in the air: at the edge of what is in front
  double registration = 0.0;  ///< standard deviation of each view's place, and of its turn at the model's rim
  std::uint64_t seed = 1;
};

/// Where the way from a to b first meets the surface; the normal looks back.
using FirstHit = std::function<std::optional<geometry::SurfacePoint>(const Vec3& a, const Vec3& b)>;

struct Scanned {
  std::vector<Vec3> points_mm;      ///< view by view, row by row
  std::vector<std::uint32_t> view;  ///< of each point
  double spacing_mm = 0.0;
};

/// The options by name, for generators and samplings of meshes alike; `only_with` is put on each.
[[nodiscard]] std::vector<OptionSpec> scanner_specs(const std::vector<OptionCondition>& only_with);
/// Of validated options that hold them; `points` and `seed` are the caller's.
[[nodiscard]] ScannerOptions read_scanner(const Options& options);

/// Scans what stands in `box`. One view looks down along z; several stand evenly around the model, those that
/// see nothing leave their share to the others; `from_above`: none below it. Each stands kStandOff radii away
/// and sends a square raster of rays that spreads from one place. Rays that graze (over 80 degrees) return
/// nothing. Bit for bit the same with any number of threads. An Error where no view sees anything, or more
/// than a hundred million rays are needed. O(rays log n).
[[nodiscard]] Result<Scanned> scan(const FirstHit& first_hit, const geometry::Aabb& box, bool from_above,
                                   const ScannerOptions& options);

}  // namespace palpate::cloud
