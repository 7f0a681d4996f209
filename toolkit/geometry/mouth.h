// How wide a body's mouth is.
#pragma once

#include <span>

#include "toolkit/geometry/enclosure.h"

namespace palpate::geometry {

/// A piece whose mouth takes more than this share is more of a vase than of a body with holes that a scanner
/// left: its user is told that it is felt from one side.
inline constexpr double kWideMouthShare = 0.05;
/// A piece whose mouth takes no more than this share is tight: a HIP behind it came in through its surface,
/// not through a hole, and is pushed out again.
inline constexpr double kTightMouthShare = 0.02;

/// The areas of a closed surface cancel as vectors (divergence theorem); what is left of an oriented piece's
/// is that of its mouth, square to it, here as a share of the piece's own: 0 of a closed one, 0.12 of a ball
/// with a mouth of 80 degrees, 0.5 of a half ball. Two mouths that face each other cancel too: of a pipe
/// nothing is told. The same for any number of threads. O(parts).
[[nodiscard]] inline double mouth_share(std::span<const SurfacePart> parts) noexcept {
  Vec3 sum = Vec3::Zero();
  double area = 0.0;
  for (const SurfacePart& part : parts) {
    sum += part.area.cast<double>();
    area += part.area.cast<double>().norm();
  }
  return area > 0.0 ? sum.norm() / area : 0.0;
}

}  // namespace palpate::geometry
