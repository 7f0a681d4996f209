// The modified octree of section 3.1.2.1 and the 3D quadtree of section 3.1.2.2.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/partition/partition.h"
#include "toolkit/partition/tree_walk.h"

namespace palpate::partition {

/// A tree that halves the first `kAxes` axes of every node with more than `max_points` points: a cube into
/// eight (Octree), or a square column along z into four (Quadtree3d). It is anchored at the cloud's low
/// corner and spans its largest extent along the axes divided. Leaves are contiguous in order(), which is the
/// Morton curve, ties by cloud index. Points that share a cube of 2^-21 of the extent, duplicates among them,
/// stay in one leaf however many they are.
///
/// Memory: 12 bytes a node. A leaf costs up to 2^kAxes nodes a level for as long as it is alone, so a cloud
/// of scattered clumps may take 21 levels for each, as the section warns. Immutable after build; safe to read
/// from many threads.
template <int kAxes>
class SpaceTree {
  static_assert(kAxes == 2 || kAxes == 3);

 public:
  static constexpr int kChildren = 1 << kAxes;
  using Nodes = LargeVector<TreeNode>;

  /// O(n log n).
  [[nodiscard]] static SpaceTree build(const cloud::Cloud& cloud, const PartitionOptions& options,
                                       int threads);

  [[nodiscard]] std::span<const std::uint32_t> order() const noexcept { return order_; }
  /// Frees order(), which only preparation needs.
  void drop_order() noexcept { std::vector<std::uint32_t>().swap(order_); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return nodes_.capacity() * sizeof(TreeNode) + order_.capacity() * sizeof(std::uint32_t);
  }
  [[nodiscard]] LeafStatistics statistics() const;

  [[nodiscard]] const Nodes& nodes() const noexcept { return nodes_; }
  [[nodiscard]] const TreeFrame& frame() const noexcept { return frame_; }
  [[nodiscard]] const PartitionOptions& options() const noexcept { return options_; }

 private:
  PartitionOptions options_;
  TreeFrame frame_;
  Nodes nodes_;
  std::vector<std::uint32_t> order_;
};

using Octree = SpaceTree<3>;
using Quadtree3d = SpaceTree<2>;

extern template class SpaceTree<2>;
extern template class SpaceTree<3>;

template <int kAxes, class Visit>
bool visit_ranges(const SpaceTree<kAxes>& tree, const Vec3& a_mm, const Vec3& b_mm, const Vec3& reach_mm,
                  Visit&& visit) {
  return visit_leaves<kAxes>(tree.nodes(), tree.frame(), a_mm, b_mm, reach_mm, [&](std::uint32_t node) {
    const TreeNode& leaf = tree.nodes()[node];
    return visit(PlaceRange{leaf.begin, leaf.end});
  });
}

template <int kAxes, class Visit>
bool visit_at(const SpaceTree<kAxes>& tree, const Vec3& point_mm, Visit&& visit) {
  if (!tree.frame().template holds<kAxes>(point_mm)) return visit(PlaceRange{});
  const TreeNode& leaf = tree.nodes()[leaf_at<kAxes>(tree.nodes(), tree.frame(), point_mm).node];
  return visit(PlaceRange{leaf.begin, leaf.end});
}

static_assert(Partition<Octree> && Partition<Quadtree3d>);

}  // namespace palpate::partition
