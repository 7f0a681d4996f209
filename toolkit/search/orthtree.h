// The modified octree (section 3.1.2.1) and the 3D quadtree (section 3.1.2.2).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/search/orthtree_traversal.h"
#include "toolkit/search/partition.h"

namespace palpate::search {

/// A tree that halves the first `kAxes` axes of every node with more than `max_points` points: a cube into
/// eight (Octree), or a square column along z into four (Quadtree3d). Starts at the cloud's low corner and
/// spans its largest extent along the divided axes. Leaves are contiguous in order(), the Morton curve with
/// ties by cloud index. Points in one cube of 2^-21 of the extent, duplicates included, share a leaf.
/// Memory: 12 bytes a node. A leaf costs up to 2^kAxes nodes a level while it is alone, so scattered clumps
/// may take 21 levels each, as the section warns. Immutable after build; thread-safe to read.
template <int kAxes>
class Orthtree {
  static_assert(kAxes == 2 || kAxes == 3);

 public:
  static constexpr int kChildren = 1 << kAxes;
  using Nodes = LargePageVector<TreeNode>;

  /// O(n log n).
  [[nodiscard]] static Orthtree build(const cloud::Cloud& cloud, const PartitionOptions& options,
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

using Octree = Orthtree<3>;
using Quadtree3d = Orthtree<2>;

extern template class Orthtree<2>;
extern template class Orthtree<3>;

template <int kAxes, class Visit>
bool visit_segment_ranges(const Orthtree<kAxes>& tree, const Vec3& a_mm, const Vec3& b_mm,
                          const Vec3& reach_mm, Visit&& visit) {
  return visit_leaves<kAxes>(tree.nodes(), tree.frame(), a_mm, b_mm, reach_mm, [&](std::uint32_t node) {
    const TreeNode& leaf = tree.nodes()[node];
    return visit(IndexRange{leaf.begin, leaf.end});
  });
}

template <int kAxes, class Visit>
bool visit_point_range(const Orthtree<kAxes>& tree, const Vec3& point_mm, Visit&& visit) {
  if (!tree.frame().template holds<kAxes>(point_mm)) return visit(IndexRange{});
  const TreeNode& leaf = tree.nodes()[leaf_at<kAxes>(tree.nodes(), tree.frame(), point_mm).node];
  return visit(IndexRange{leaf.begin, leaf.end});
}

static_assert(Partition<Octree> && Partition<Quadtree3d>);

}  // namespace palpate::search
