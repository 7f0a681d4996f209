// Planes fitted to surrounding points, for paths on surfaces without formula or faces. Internal to paths.
#pragma once

#include <cstddef>
#include <memory>

#include <palpate/aabb.h>
#include <palpate/cloud.h>
#include <palpate/result.h>
#include "toolkit/search/point_search.h"

namespace palpate::paths {

/// Fewer points form no surface for a path.
inline constexpr std::size_t kMinInBall = 16;
/// Most points read by a fit, so that a clump of duplicates cannot slow a frame.
inline constexpr std::size_t kMaxFitted = 4096;
/// A plane fitted around a point.
struct PlaneFit {
  bool good = false;
  Vec3 normal = Vec3::UnitZ();
  double height = 0.0;  ///< of the plane above the point, along the normal
};

/// The plane through the points within `radius` of `p` (relative to the cloud's origin), with weights falling
/// smoothly to zero; its normal is on the side of `side`. Invalid where the points end.
[[nodiscard]] PlaneFit fit_plane(const search::PointSearch& points, const Vec3& p, double radius,
                                 const Vec3& side);

/// Fit radius, and a search with cells of that size.
struct FitSearch {
  double radius_mm = 0.0;
  std::unique_ptr<search::PointSearch> points;
};

/// A radius at which the median ball holds 16 to 64 points, as far as uneven clouds allow. O(n log n).
[[nodiscard]] Result<FitSearch> choose_fit_radius(const cloud::Cloud& cloud, const geometry::Aabb& box);

}  // namespace palpate::paths
