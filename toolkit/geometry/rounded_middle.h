// A point between two points of a round surface.
#pragma once

#include "toolkit/core/vec.h"

namespace palpate::geometry {

/// The middle of a cubic Hermite segment over a chord: half way, and an eighth of what its ends' tangents
/// differ by.
inline constexpr double kHermiteMiddle = 0.125;

/// The middle of the curve that leaves both ends along their planes. Unit normals, or zero where there is
/// none.
[[nodiscard]] inline Vec3 rounded_middle(const Vec3& a, const Vec3& b, const Vec3& normal_a,
                                         const Vec3& normal_b) noexcept {
  const Vec3 chord = b - a;
  const Vec3 middle = 0.5 * (a + b);
  if (normal_a == Vec3::Zero() || normal_b == Vec3::Zero()) return middle;
  const Vec3 along_a = chord - normal_a * normal_a.dot(chord);
  const Vec3 along_b = chord - normal_b * normal_b.dot(chord);
  return middle + kHermiteMiddle * (along_a - along_b);
}

}  // namespace palpate::geometry
