// Sphere swept along a segment against axis-aligned box (section 3.1.4, second remedy).
#pragma once

#include <algorithm>
#include <cmath>

#include "toolkit/geometry/segment_box.h"

namespace palpate::geometry {

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
