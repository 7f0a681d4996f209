// Local planes of a cloud: the normal of each point from its neighbours, without a side. Which side is
// outside is decided by where the probe comes from, not here.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/vec.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::surface {

/// A direction in 32 bits: the octahedral map, 16 bits a coordinate (Meyer et al. 2010). Worst error 4e-5
/// rad.
using NormalCode = std::uint32_t;
/// The code of "no plane": fewer than two neighbours, or all on a line.
inline constexpr NormalCode kNoNormal = 0xFFFFFFFFu;

[[nodiscard]] NormalCode encode_normal(const Vec3& unit) noexcept;

/// The unit vector of a code other than kNoNormal. Allocates nothing.
[[nodiscard]] inline Vec3 decode_normal(NormalCode code) noexcept {
  // 65534 steps over [-1, 1], so that 0 is exact and 0xFFFF never occurs.
  constexpr double kStep = 1.0 / 32767.0;
  double x = static_cast<double>(code & 0xFFFFu) * kStep - 1.0;
  double y = static_cast<double>(code >> 16) * kStep - 1.0;
  const double z = 1.0 - std::abs(x) - std::abs(y);
  if (z < 0.0) {
    const double folded_x = std::copysign(1.0 - std::abs(y), x);
    y = std::copysign(1.0 - std::abs(x), y);
    x = folded_x;
  }
  const double scale = 1.0 / std::sqrt(x * x + y * y + z * z);
  return {x * scale, y * scale, z * scale};
}

/// The normal of the least-squares plane through each point and its neighbours (the eigenvector of the
/// covariance's smallest eigenvalue), its sign arbitrary. Parallel; the same for any number of threads. O(n).
[[nodiscard]] std::vector<NormalCode> plane_normals(const cloud::Cloud& cloud,
                                                    const neighbourhood::NeighbourTable& table, int threads);

}  // namespace palpate::surface
