// Neighbourhood information: what every builder makes and every walk reads (section 3.2.2 of the thesis).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace palpate::neighbourhood {

/// Section 3.2.2.5: eight neighbours a point.
inline constexpr std::size_t kNeighbours = 8;

/// Up to eight neighbours of one point, nearest first, ties by index. Unused places hold the point's own
/// index, so that a walk needs no count: moving to oneself is never an improvement.
using Neighbours = std::array<std::uint32_t, kNeighbours>;

/// One entry per point, in the cloud's own order.
struct NeighbourTable {
  std::vector<Neighbours> of;

  [[nodiscard]] std::size_t size() const noexcept { return of.size(); }
  /// How many of the eight places are used.
  [[nodiscard]] std::size_t count(std::size_t point) const noexcept {
    std::size_t n = 0;
    for (const std::uint32_t other : of[point]) n += other != point;
    return n;
  }
};

}  // namespace palpate::neighbourhood
