// Where a god object rests that more than one facet holds: at the bottom of a groove, in a corner of three
// planes.
#pragma once

#include "toolkit/points/sheet.h"
#include "toolkit/render/shading.h"

namespace palpate::render {

/// A facet turned from the plane of its point by less than this (sine; 3.6 degrees) is taken for the whole
/// surface there: the force is then off by less than the 7 % that a hand can tell apart.
inline constexpr double kCreaseSine = 1.0 / 16.0;

/// Whether a facet stands at a crease of the sheet. Scale free.
[[nodiscard]] inline bool at_crease(const FacetPlane& plane, const Vec3& outward) noexcept {
  const double along = plane.scaled_normal.dot(outward);
  return along * along < (1.0 - kCreaseSine * kCreaseSine) * plane.area_sq;
}

/// Whether the foot of r on the plane of a facet lies beside it, beyond the line to corner b or c; all
/// relative to its first corner.
[[nodiscard]] inline bool beside(const FacetPlane& plane, const Vec3& b, const Vec3& c,
                                 const Vec3& r) noexcept {
  return plane.scaled_normal.dot(b.cross(r)) < 0.0 || plane.scaled_normal.dot(c.cross(r)) > 0.0;
}

/// The vector from `h` to the nearest place on the fan of facets between the walk's end and all its
/// neighbours, each facet going on outward without end: a facet, the line between two of them, or the point
/// itself. Where the facets make a groove or a corner, this is what the planes of Zilles and Salisbury (1995)
/// allow, and it changes continuously with h. `pull` where the neighbours do not surround the point. At most
/// eight facets and eight lines; allocates nothing.
[[nodiscard]] Vec3 pull_at_crease(const PointModel& model, const WalkEnd& end, const Vec3& outward,
                                  const Vec3& h, const Vec3& pull) noexcept;

}  // namespace palpate::render
