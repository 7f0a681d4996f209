// Unit directions packed into 32 bits.
#pragma once

#include <cmath>
#include <cstdint>

#include <palpate/vec.h>

namespace palpate::surface {

/// 31 bits of direction by the octahedral map (Meyer et al. 2010; 16 and 15 bits a coordinate, error at most
/// 1e-4 rad) and one bit for "closed surface, outward normal".
using NormalCode = std::uint32_t;
/// The code for "no plane": fewer than two neighbours, or all on a line.
inline constexpr NormalCode kNoNormal = 0xFFFFFFFFu;
/// Set if the surface encloses a volume and the normal points outward: it is touched from one side.
inline constexpr NormalCode kOneSided = 0x80000000u;

/// Steps over [-1, 1]: even, so that 0 is exact. x has one step less than its bits allow, so kNoNormal cannot
/// occur.
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

/// The code of the opposite direction; keeps the side bit.
[[nodiscard]] NormalCode opposite(NormalCode code) noexcept;

}  // namespace palpate::surface
