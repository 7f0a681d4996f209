// Neighbour tables, made by builders and read by walks (section 3.2.2).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace palpate::search {

/// Section 3.2.2.5: eight neighbours a point.
inline constexpr std::size_t kNeighbours = 8;

/// Up to eight neighbours of a point, nearest first, ties by index. Unused places hold the point's own index,
/// so a walk needs no count: moving to oneself never improves.
using Neighbours = std::array<std::uint32_t, kNeighbours>;

/// One entry per point, in the cloud's order.
struct NeighbourTable {
  std::vector<Neighbours> of;

  [[nodiscard]] std::size_t size() const noexcept { return of.size(); }
  /// The number of used places.
  [[nodiscard]] std::size_t count(std::size_t point) const noexcept {
    std::size_t n = 0;
    for (const std::uint32_t other : of[point]) n += other != point;
    return n;
  }
};

}  // namespace palpate::search
