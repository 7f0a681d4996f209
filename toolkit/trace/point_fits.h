// Planes fitted to the points around a place: what path generators know of a surface that has neither a
// formula nor faces. Internal to trace.
#pragma once

#include <cstddef>
#include <memory>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/partition/point_search.h"

namespace palpate::trace {

/// Fewer points do not make a surface that a path could follow.
inline constexpr std::size_t kFewestInBall = 16;
/// A fit reads at most this many points, so that a clump of duplicates cannot make a frame slow.
inline constexpr std::size_t kMostFitted = 4096;
/// A plane fitted around a point.
struct Fit {
  bool good = false;
  Vec3 normal = Vec3::UnitZ();
  double height = 0.0;  ///< of the plane above the point, along the normal
};

/// The plane through the points within `radius` of `p` (relative to the cloud's origin), weights falling
/// smoothly to zero; its normal on the side of `side`. Not good where the points end.
[[nodiscard]] Fit fit_plane(const partition::PointSearch& points, const Vec3& p, double radius,
                            const Vec3& side);

/// Radius of the fits, with the search whose cells are that large.
struct Fitting {
  double radius_mm = 0.0;
  std::unique_ptr<partition::PointSearch> points;
};

/// A radius at which the median ball holds 16 to 64 points, as near as uneven clouds allow. O(n log n).
[[nodiscard]] Result<Fitting> choose_radius(const cloud::Cloud& cloud, const geometry::Aabb& box);

}  // namespace palpate::trace
