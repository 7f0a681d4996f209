// The triangles of a star mesh near a segment or a box: a tree of boxes over blocks of consecutive places,
// eight to a node. It follows uneven spacing and any scale, at some six bytes a point.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/core/unset_vector.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/stars/float_box.h"
#include "toolkit/stars/star_mesh.h"

namespace palpate::stars {

/// Levels: 8^11 blocks are more than 32 bits count.
inline constexpr int kMaxLevels = 11;

/// Levels that are asked for ahead of a look: the third has a node for each 4,096 places.
inline constexpr std::size_t kLevelsAhead = 2;

/// The layer that a block's triangles lie in: along its mean normal, from `low` to `high`. On a smooth
/// surface it is thinner than the box by as much as the box is tilted.
struct Layer {
  std::array<float, 3> normal{};
  float low, high;
  /// The way between two places stays on one side of it.
  [[nodiscard]] bool misses(const Vec3& from, const Vec3& to) const noexcept {
    const Vec3 n(static_cast<double>(normal[0]), static_cast<double>(normal[1]),
                 static_cast<double>(normal[2]));
    const double a = n.dot(from), b = n.dot(to);
    const auto lowest = static_cast<double>(low), highest = static_cast<double>(high);
    return (a > highest && b > highest) || (a < lowest && b < lowest);
  }
};

class StarTree {
 public:
  /// Parallel, O(n).
  static StarTree build(const StarMesh& mesh, int threads);
  /// Triangles of these blocks (sorted, each once) have moved: their boxes and layers and the boxes above
  /// them are made anew. `blocks` is written over. O(blocks) for each level.
  void refit(const StarMesh& mesh, std::span<std::uint32_t> blocks) noexcept;
  /// A corner of a block's triangles has gone to `p`: its box and layer and the boxes above them grow to hold
  /// it, and get no smaller. O(levels).
  void grow(std::uint32_t block, const Vec3& p) noexcept;

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
  [[nodiscard]] const Layer& layer(std::uint32_t block) const noexcept { return layers_[block]; }
  /// Asks for what for_blocks() reads of the nodes above a block; the higher ones are never far.
  void prefetch_above(std::uint32_t block) const noexcept {
    for (std::size_t level = 0; level < std::min<std::size_t>(levels_.size(), kLevelsAhead); ++level) {
      const auto* node = reinterpret_cast<const char*>(&levels_[level][block >> (3 * (level + 1))]);
      for (std::size_t at = 0; at < sizeof(BoxNode); at += kLineBytes) __builtin_prefetch(node + at);
    }
  }
  /// Asks for a block's layer and places.
  void prefetch(const StarMesh& mesh, std::uint32_t block) const noexcept {
    __builtin_prefetch(&layers_[block]);
    mesh.prefetch_block(block);
  }
  /// When it was built.
  [[nodiscard]] geometry::Aabb box_mm() const noexcept { return box_mm_; }
  [[nodiscard]] std::size_t bytes() const noexcept;

 private:
  void fit_block(const StarMesh& mesh, std::uint32_t block) noexcept;

  std::vector<LargeVector<BoxNode>> levels_;  ///< 0: whose children are blocks; the last has one node
  LargeUnsetVector<Layer> layers_;            ///< of each block
  geometry::Aabb box_mm_;
};

}  // namespace palpate::stars
