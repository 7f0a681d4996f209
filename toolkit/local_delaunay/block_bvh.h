// A bounding volume hierarchy over blocks of consecutive places. It finds a mesh's triangles near a segment
// or box, with eight children a node. It adapts to uneven spacing and any scale; about six bytes a point.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/vec.h>
#include "toolkit/core/hardware.h"
#include "toolkit/local_delaunay/bvh_node.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"

namespace palpate::local_delaunay {

/// Most levels: 8^11 blocks exceed 32 bits.
inline constexpr int kMaxLevels = 11;

/// Levels prefetched before a query; the third has one node per 4,096 places.
inline constexpr std::size_t kLevelsAhead = 2;

/// The slab that holds a block's triangles: along its mean normal, from `low` to `high`. On a smooth surface
/// it is thinner than a tilted box.
struct Layer {
  std::array<float, 3> normal{};
  float low, high;
  /// True if the segment stays on one side.
  [[nodiscard]] bool misses(const Vec3& from, const Vec3& to) const noexcept {
    const Vec3 n(static_cast<double>(normal[0]), static_cast<double>(normal[1]),
                 static_cast<double>(normal[2]));
    const double a = n.dot(from), b = n.dot(to);
    const auto lowest = static_cast<double>(low), highest = static_cast<double>(high);
    return (a > highest && b > highest) || (a < lowest && b < lowest);
  }
};

class BlockBvh {
 public:
  /// Parallel, O(n).
  static BlockBvh build(const LocalDelaunayMesh& mesh, int threads);
  /// Without tree and layers: for_blocks() reads every triangle of `mesh`, which must outlive this and not
  /// change. The reference for tests of the tree.
  static BlockBvh none(const LocalDelaunayMesh& mesh);
  [[nodiscard]] bool is_none() const noexcept { return all_of_ != nullptr; }
  /// Rebuilds boxes and layers of blocks with moved triangles, and the boxes above. `blocks` is sorted
  /// without repetition and is overwritten. O(blocks) a level.
  void refit(const LocalDelaunayMesh& mesh, std::span<std::uint32_t> blocks) noexcept;
  /// A corner of the block moved to `p`: grows its box and layer, and the boxes above, to hold it. Nothing
  /// shrinks. O(levels).
  void grow(std::uint32_t block, const Vec3& p) noexcept;

  /// Calls visit(block, node, child) for every block whose box meets `box`, until it returns false. False if
  /// that, or the limit of `most` nodes, ended the visit.
  template <class Visit>
  bool for_blocks(const geometry::Aabb& box, std::uint32_t most, Visit&& visit) const noexcept {
    const FloatBox query = FloatBox::around(box);
    if (levels_.empty()) return !is_none() || for_all_blocks(query, visit);
    // Depth first; per level the remaining children.
    std::array<unsigned, kMaxLevels> left{};
    std::array<std::uint32_t, kMaxLevels> node{};
    std::size_t level = levels_.size() - 1;
    const std::size_t top = level;
    std::uint32_t visited = 1;
    left[level] = levels_[level][0].meets(query);
    for (;;) {
      if (left[level] == 0) {
        if (level++ == top) return true;
        continue;
      }
      const auto child = static_cast<std::uint32_t>(__builtin_ctz(left[level]));
      left[level] &= left[level] - 1;
      const std::uint32_t index = node[level] * kBvhWidth + child;
      if (level == 0) {
        if (!visit(index, levels_[0][node[0]], child)) return false;
        continue;
      }
      if (++visited > most) return false;
      --level;
      node[level] = index;
      left[level] = levels_[level][index].meets(query);
    }
  }
  [[nodiscard]] const Layer& layer(std::uint32_t block) const noexcept { return layers_[block]; }
  /// Prefetches the nodes above a block; the higher ones are usually cached.
  void prefetch_above(std::uint32_t block) const noexcept {
    for (std::size_t level = 0; level < std::min<std::size_t>(levels_.size(), kLevelsAhead); ++level) {
      const auto* node = reinterpret_cast<const char*>(&levels_[level][block >> (3 * (level + 1))]);
      for (std::size_t at = 0; at < sizeof(BvhNode); at += kLineBytes) __builtin_prefetch(node + at);
    }
  }
  /// Prefetches a block's layer and places.
  void prefetch(const LocalDelaunayMesh& mesh, std::uint32_t block) const noexcept {
    __builtin_prefetch(&layers_[block]);
    mesh.prefetch_block(block);
  }
  /// The box at build time.
  [[nodiscard]] geometry::Aabb box_mm() const noexcept { return box_mm_; }
  [[nodiscard]] std::size_t bytes() const noexcept;

 private:
  template <class Visit>
  bool for_all_blocks(const FloatBox& query, Visit&& visit) const noexcept {
    for (std::uint32_t block = 0; block < layers_.size(); ++block) {
      BvhNode node = BvhNode::empty();
      all_of_->for_triangles_of_block(block, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
        const FloatBox triangle = all_of_->triangle_box(a, b, c);
        for (std::size_t axis = 0; axis < 3; ++axis) {
          node.low[axis][0] = std::min(node.low[axis][0], triangle.low[axis]);
          node.high[axis][0] = std::max(node.high[axis][0], triangle.high[axis]);
        }
      });
      if ((node.meets(query) & 1u) != 0 && !visit(block, node, 0u)) return false;
    }
    return true;
  }
  void fit_block(const LocalDelaunayMesh& mesh, std::uint32_t block) noexcept;

  std::vector<LargePageVector<BvhNode>> levels_;  ///< level 0: children are blocks; the last level has one
                                                  ///< node
  LargePageUninitializedVector<Layer> layers_;    ///< per block
  geometry::Aabb box_mm_;
  const LocalDelaunayMesh* all_of_ = nullptr;  ///< the mesh, if there is no tree
};

}  // namespace palpate::local_delaunay
