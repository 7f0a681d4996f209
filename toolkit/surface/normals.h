// Directions of local planes, in 32 bits.
#pragma once

#include <cmath>
#include <cstdint>

#include "toolkit/core/vec.h"

namespace palpate::surface {

/// A direction in 31 bits, the octahedral map with 16 and 15 bits a coordinate (Meyer et al. 2010), worst
/// error 1e-4 rad; and one bit: the surface is closed and the direction points out of it.
using NormalCode = std::uint32_t;
/// The code of "no plane": fewer than two neighbours, or all on a line.
inline constexpr NormalCode kNoNormal = 0xFFFFFFFFu;
/// Set where the surface encloses a volume and the normal points out of it: it is touched from one side.
inline constexpr NormalCode kOneSided = 0x80000000u;

/// Steps over [-1, 1]: even, so that 0 is exact; of x one less than its bits hold, so that kNoNormal never
/// occurs.
inline constexpr double kNormalStepsX = 65534.0, kNormalStepsY = 32766.0;

[[nodiscard]] NormalCode encode_normal(const Vec3& unit) noexcept;

[[nodiscard]] inline bool is_one_sided(NormalCode code) noexcept {
  return (code & kOneSided) != 0 && code != kNoNormal;
}

/// The unit vector of a code other than kNoNormal. Allocates nothing.
[[nodiscard]] inline Vec3 decode_normal(NormalCode code) noexcept {
  double x = static_cast<double>(code & 0xFFFFu) * (2.0 / kNormalStepsX) - 1.0;
  double y = static_cast<double>((code >> 16) & 0x7FFFu) * (2.0 / kNormalStepsY) - 1.0;
  const double z = 1.0 - std::abs(x) - std::abs(y);
  if (z < 0.0) {
    const double folded_x = std::copysign(1.0 - std::abs(y), x);
    y = std::copysign(1.0 - std::abs(x), y);
    x = folded_x;
  }
  const double scale = 1.0 / std::sqrt(x * x + y * y + z * z);
  return {x * scale, y * scale, z * scale};
}

/// The code of the opposite direction, the side bit kept.
[[nodiscard]] NormalCode opposite(NormalCode code) noexcept;

}  // namespace palpate::surface
