// Segment against axis-aligned box by separating axes: the narrow phase of section 3.1.1.2.
#pragma once

#include <cmath>

#include "toolkit/core/tolerances.h"
#include "toolkit/core/vec.h"

namespace palpate::geometry {

/// A segment prepared for tests against many boxes: middle and half vector. A segment whose ends are equal is
/// a point, and the test becomes point in box.
struct SegmentProbe {
  Vec3 middle_mm;
  Vec3 half_mm;      ///< from the middle to the second end
  Vec3 half_abs_mm;  ///< componentwise magnitude of half_mm

  SegmentProbe(const Vec3& a_mm, const Vec3& b_mm) noexcept
      : middle_mm(0.5 * (a_mm + b_mm)), half_mm(0.5 * (b_mm - a_mm)), half_abs_mm(half_mm.cwiseAbs()) {}
};

/// Rounded operations behind one side of a cross-axis comparison below: differences, two products and a sum
/// per side.
inline constexpr int kSegmentBoxOperations = 8;

/// True when the segment touches the closed box (centre, half lengths). Six separating axes: the three box
/// axes and their cross products with the segment (Gottschalk's theorem; Ericson 2005, 5.3.3 names the same
/// axes). Rounding is resolved towards "touches": each comparison is widened by its own rounding bound, which
/// is relative to the operands and so works at every scale. No branch depends on the segment's length.
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
  // On a cross axis the rounding error is relative to the products themselves, so it is added, not
  // multiplied.
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

}  // namespace palpate::geometry
