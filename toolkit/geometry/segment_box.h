// Segment, and sphere swept along it, against axis-aligned box: the narrow phase of section 3.1.1.2 by
// separating axes, and the second remedy of section 3.1.4.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <palpate/vec.h>
#include "toolkit/core/tolerances.h"

namespace palpate::geometry {

/// A segment prepared for many box tests: centre and half vector. With equal ends it is a point.
struct SegmentProbe {
  Vec3 middle_mm;
  Vec3 half_mm;      ///< from the centre to the second end
  Vec3 half_abs_mm;  ///< componentwise magnitude of half_mm

  SegmentProbe(const Vec3& a_mm, const Vec3& b_mm) noexcept
      : middle_mm(0.5 * (a_mm + b_mm)), half_mm(0.5 * (b_mm - a_mm)), half_abs_mm(half_mm.cwiseAbs()) {}
};

/// Rounded operations on one side of a cross-axis comparison: differences, two products and a sum.
inline constexpr int kSegmentBoxOperations = 8;

/// True if the segment touches the closed box (centre, half lengths). Tests six separating axes: the box axes
/// and their cross products with the segment (Gottschalk; Ericson 2005, 5.3.3). Rounding favours "touches":
/// each comparison is widened by its own relative rounding bound, so it works at every scale. No branch
/// depends on the segment's length.
[[nodiscard]] inline bool segment_touches_box(const SegmentProbe& segment, const Vec3& centre_mm,
                                              const Vec3& half_box_mm) noexcept {
  constexpr double kSlack = 1.0 + 2.0 * gamma(kSegmentBoxOperations);
  const Vec3 m = segment.middle_mm - centre_mm;
  const Vec3 ma = m.cwiseAbs();
  const Vec3& d = segment.half_mm;
  const Vec3& da = segment.half_abs_mm;
  if (ma.x() > (half_box_mm.x() + da.x()) * kSlack) return false;
  if (ma.y() > (half_box_mm.y() + da.y()) * kSlack) return false;
  if (ma.z() > (half_box_mm.z() + da.z()) * kSlack) return false;
  // On a cross axis the rounding error is relative to the products, so it is added, not multiplied.
  constexpr double kBound = gamma(kSegmentBoxOperations);
  const double yz = ma.y() * da.z() + ma.z() * da.y();
  const double zx = ma.z() * da.x() + ma.x() * da.z();
  const double xy = ma.x() * da.y() + ma.y() * da.x();
  if (std::abs(m.y() * d.z() - m.z() * d.y()) >
      half_box_mm.y() * da.z() + half_box_mm.z() * da.y() + kBound * yz)
    return false;
  if (std::abs(m.z() * d.x() - m.x() * d.z()) >
      half_box_mm.z() * da.x() + half_box_mm.x() * da.z() + kBound * zx)
    return false;
  return std::abs(m.x() * d.y() - m.y() * d.x()) <=
         half_box_mm.x() * da.y() + half_box_mm.y() * da.x() + kBound * xy;
}

/// The parameters at which a -> a + d is within the sphere of this radius about the origin, or none. At least
/// one lies in [0, 1], or one on either side.
[[nodiscard]] inline std::optional<std::pair<double, double>> segment_sphere_interval(
    const Vec3& a, const Vec3& d, double radius) noexcept {
  const double dd = d.squaredNorm();
  if (!(dd > 0.0)) return std::nullopt;
  const double nearest = -a.dot(d) / dd;
  // Measured from the point nearest to the centre, not from a: no cancellation for far starts.
  const double miss_sq = (a + nearest * d).squaredNorm();
  const double half_sq = (radius * radius - miss_sq) / dd;
  if (half_sq < 0.0) return std::nullopt;
  const double half = std::sqrt(half_sq);
  if (nearest + half < 0.0 || nearest - half > 1.0) return std::nullopt;
  return std::pair{nearest - half, nearest + half};
}

/// Squared distance between a segment and a closed box (centre, half lengths), 0 if they touch. Along the
/// segment it is convex and piecewise quadratic with breaks at the six face planes; the slope's signs there
/// find the piece with the minimum, without search or tolerance. A segment with equal ends is a point.
[[nodiscard]] inline double segment_box_distance_sq(const SegmentProbe& segment, const Vec3& centre_mm,
                                                    const Vec3& half_box_mm) noexcept {
  const Vec3 m = segment.middle_mm - centre_mm;
  const Vec3& d = segment.half_mm;
  /// From the box to the segment's point at t in [-1, 1].
  const auto beyond = [&](double t) {
    const Vec3 p = m + t * d;
    return Vec3(p - p.cwiseMax(-half_box_mm).cwiseMin(half_box_mm));
  };
  double low = -1.0, high = 1.0;
  double slope_low = beyond(low).dot(d), slope_high = beyond(high).dot(d);
  if (slope_low >= 0.0) return beyond(low).squaredNorm();
  if (slope_high <= 0.0) return beyond(high).squaredNorm();
  for (int axis = 0; axis < 3; ++axis) {
    if (d[axis] == 0.0) continue;
    for (const double face : {-half_box_mm[axis], half_box_mm[axis]}) {
      const double t = (face - m[axis]) / d[axis];
      if (!(t > low && t < high)) continue;
      const double slope = beyond(t).dot(d);
      (slope < 0.0 ? low : high) = t;
      (slope < 0.0 ? slope_low : slope_high) = slope;
    }
  }
  const double t = low - slope_low * (high - low) / (slope_high - slope_low);
  return beyond(std::clamp(t, low, high)).squaredNorm();
}

/// True if a sphere of `radius_mm` swept along the segment touches the closed box. Rounding favours
/// "touches", as in segment_touches_box.
[[nodiscard]] inline bool swept_sphere_touches_box(const SegmentProbe& segment, double radius_mm,
                                                   const Vec3& centre_mm, const Vec3& half_box_mm) noexcept {
  if (!segment_touches_box(segment, centre_mm, half_box_mm + Vec3::Constant(radius_mm))) return false;
  // Bound on roundings of the largest term in each coordinate of `beyond`.
  constexpr int kOperations = 16;
  const Vec3 size = (segment.middle_mm - centre_mm).cwiseAbs() + segment.half_abs_mm + half_box_mm;
  const double reach = radius_mm + gamma(kOperations) * size.maxCoeff();
  return segment_box_distance_sq(segment, centre_mm, half_box_mm) <= reach * reach;
}

}  // namespace palpate::geometry
