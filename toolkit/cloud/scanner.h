// A simulated scanner: casts rays from around a surface and adds measurement errors.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include <palpate/analytic_surface.h>
#include <palpate/geometry.h>
#include <palpate/options.h>
#include <palpate/result.h>

namespace palpate::cloud {

/// Mesh indices are 32 bits, and a hundred million points with their mesh fill a desktop's memory.
inline constexpr double kMaxGeneratedPoints = 1e8;

/// Lengths in spacings: the distance of adjacent rays in the model's middle.
struct ScannerOptions {
  double points = 0.0;        ///< wanted before dropout, over all views
  int views = 1;              ///< scanner positions
  double noise = 0.0;         ///< standard deviation of the range, along the ray
  double bias = 0.0;          ///< range error at 60 degrees of incidence, growing as 1 / cos - 1 from 0
  double dropout = 0.0;       ///< share of rays without return
  double flying = 0.0;        ///< share of points in the air at edges
  double registration = 0.0;  ///< standard deviation of each view's position, and of its rotation at the
                              ///< model's rim
  std::uint64_t seed = 1;
};

/// The first surface hit from a to b; the normal points back.
using FirstHit = std::function<std::optional<geometry::SurfacePoint>(const Vec3& a, const Vec3& b)>;

struct Scanned {
  std::vector<Vec3> points_mm;      ///< view by view, row by row
  std::vector<std::uint32_t> view;  ///< of each point
  double spacing_mm = 0.0;
};

/// The options by name, for generators and mesh samplings; `only_with` is added to each.
[[nodiscard]] std::vector<OptionSpec> scanner_specs(const std::vector<OptionCondition>& only_with);
/// Reads validated options; the caller sets `points` and `seed`.
[[nodiscard]] ScannerOptions read_scanner(const Options& options);

/// Scans what is in `box`. One view looks down along z; several are spread evenly around, and blind ones
/// leave their share to the others; `from_above`: none below. Each stands kStandOff radii away and sends a
/// square raster of diverging rays. Rays over 80 degrees of incidence return nothing. Bit-identical for any
/// number of threads. An Error if nothing is seen or over a hundred million rays are needed. O(rays log n).
[[nodiscard]] Result<Scanned> scan(const FirstHit& first_hit, const geometry::Aabb& box, bool from_above,
                                   const ScannerOptions& options);

}  // namespace palpate::cloud
