// The triangles of a star mesh near a segment or a box: a tree of boxes over blocks of consecutive places,
// eight to a node. It follows uneven spacing and any scale, at some three and a half bytes a point.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/stars/star_mesh.h"

namespace palpate::stars {

/// Places a block: its box holds the triangles whose lowest place is in it.
inline constexpr std::uint32_t kBlockPlaces = 8;
/// Children of a node, whose boxes are tested side by side.
inline constexpr std::uint32_t kFanOut = 8;
/// Levels: 8^11 blocks are more than 32 bits count.
inline constexpr int kMaxLevels = 11;

/// A box in floats that holds one in doubles.
struct FloatBox {
  std::array<float, 3> low, high;
  static FloatBox around(const geometry::Aabb& box) noexcept;
};

/// Eight boxes, one coordinate after the other. An empty one has low above high.
struct alignas(32) BoxNode {
  std::array<std::array<float, kFanOut>, 3> low, high;
  /// Bit k: box k meets `box`.
  [[nodiscard]] unsigned meets(const FloatBox& box) const noexcept {
    unsigned mask = 0;
    std::array<unsigned char, kFanOut> yes;
    for (std::uint32_t k = 0; k < kFanOut; ++k)
      yes[k] = static_cast<unsigned char>(
          static_cast<int>(low[0][k] <= box.high[0]) & static_cast<int>(high[0][k] >= box.low[0]) &
          static_cast<int>(low[1][k] <= box.high[1]) & static_cast<int>(high[1][k] >= box.low[1]) &
          static_cast<int>(low[2][k] <= box.high[2]) & static_cast<int>(high[2][k] >= box.low[2]));
    for (std::uint32_t k = 0; k < kFanOut; ++k) mask |= static_cast<unsigned>(yes[k]) << k;
    return mask;
  }
};

class StarTree {
 public:
  /// Parallel, O(n).
  static StarTree build(const StarMesh& mesh, int threads);

  /// visit(block, its box's node and child) for every block whose box meets `box`; false stops. Looks at no
  /// more than `most` nodes; false where that or visit() ended it.
  template <class Visit>
  bool for_blocks(const geometry::Aabb& box, std::uint32_t most, Visit&& visit) const noexcept {
    if (levels_.empty()) return true;
    const FloatBox query = FloatBox::around(box);
    // Depth first: at each level the children that are left.
    std::array<unsigned, kMaxLevels> left{};
    std::array<std::uint32_t, kMaxLevels> node{};
    std::size_t level = levels_.size() - 1;
    const std::size_t top = level;
    std::uint32_t looked = 1;
    left[level] = levels_[level][0].meets(query);
    for (;;) {
      if (left[level] == 0) {
        if (level++ == top) return true;
        continue;
      }
      const auto child = static_cast<std::uint32_t>(__builtin_ctz(left[level]));
      left[level] &= left[level] - 1;
      const std::uint32_t index = node[level] * kFanOut + child;
      if (level == 0) {
        if (!visit(index, levels_[0][node[0]], child)) return false;
        continue;
      }
      if (++looked > most) return false;
      --level;
      node[level] = index;
      left[level] = levels_[level][index].meets(query);
    }
  }
  [[nodiscard]] geometry::Aabb box_mm() const noexcept { return box_mm_; }
  [[nodiscard]] std::size_t bytes() const noexcept;

 private:
  std::vector<LargeVector<BoxNode>> levels_;  ///< 0: whose children are blocks; the last has one node
  geometry::Aabb box_mm_;
};

}  // namespace palpate::stars
