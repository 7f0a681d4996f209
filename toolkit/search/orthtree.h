// The modified octree and 3D quadtree (sections 3.1.2.1, 3.1.2.2). Queries give the leaf of a point and all
// leaves that a segment touches.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/core/hardware.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/segment_box.h"
#include "toolkit/search/morton_order.h"
#include "toolkit/search/partition.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::search {

/// A node of a tree that halves its axes: eight or four children.
struct TreeNode {
  std::uint32_t begin = 0, end = 0;  ///< its places at build
  std::uint32_t child = 0;           ///< first of its consecutive children; 0: a leaf
};

/// The child of a level `level` + 1 node that holds the cube.
template <int kAxes>
[[nodiscard]] inline std::uint32_t child_of(const std::int64_t (&cube)[3], int level) noexcept {
  std::uint32_t child = 0;
  for (int axis = 0; axis < kAxes; ++axis)
    child |= static_cast<std::uint32_t>(cube[axis] >> level & 1) << axis;
  return child;
}

/// Calls visit(its places) for every leaf that a widened segment touches, in Morton order. Lengths are in
/// lattice cubes from the root's low corner, so node boxes are exact.
template <int kAxes, class Visit>
class OrthtreeTraversal {
 public:
  using Nodes = LargePageVector<TreeNode>;

  OrthtreeTraversal(const Nodes& nodes, const Lattice& lattice, const Vec3& a_mm, const Vec3& b_mm,
                    const Vec3& reach_mm, Visit& visit) noexcept
      : nodes_(nodes), visit_(visit), probe_(in_cubes(lattice, a_mm), in_cubes(lattice, b_mm)) {
    // Tolerance: a node's points may be rounded over its border by kCellSlack, and the segment by its
    // distance. Operations: two differences, a product, half a sum, and those of a box test.
    constexpr int kOperations = 4 + 2 * geometry::kSegmentBoxOperations;
    const Vec3 size = probe_.middle_mm.cwiseAbs() + probe_.half_abs_mm;
    reach_ = flat(reach_mm * lattice.per_mm) + flat(Vec3::Constant(kCellSlack)) +
             gamma(kOperations) * (size + flat(from_lattice(lattice)));
    const Vec3 around = probe_.half_abs_mm + reach_;
    low_ = probe_.middle_mm - around;
    high_ = probe_.middle_mm + around;
  }

  /// Visits the leaves below the root; false when stopped. At most kMortonBits + 1 calls deep.
  bool run() {
    Vec3 middle = Vec3::Zero();
    const double half = std::ldexp(0.5, kMortonBits);
    for (int axis = 0; axis < kAxes; ++axis) middle[axis] = half;
    return !touches(middle, half) || descend(0, middle, half);
  }

 private:
  /// Zeroes axes that are not divided.
  static Vec3 flat(Vec3 v) noexcept {
    for (int axis = kAxes; axis < 3; ++axis) v[axis] = 0.0;
    return v;
  }
  static Vec3 in_cubes(const Lattice& lattice, const Vec3& p_mm) noexcept {
    return flat((p_mm - lattice.low_mm) * lattice.per_mm);
  }
  /// Magnitude of the term subtracted in in_cubes.
  static Vec3 from_lattice(const Lattice& lattice) noexcept {
    return lattice.low_mm.cwiseAbs() * lattice.per_mm;
  }
  bool touches(const Vec3& middle, double half) const noexcept {
    return geometry::segment_touches_box(probe_, middle, reach_ + flat(Vec3::Constant(half)));
  }

  bool descend(std::uint32_t node, const Vec3& middle, double half) {
    const std::uint32_t first = nodes_[node].child;
    if (first == 0) return visit_(IndexRange{nodes_[node].begin, nodes_[node].end});
    // Excludes, per axis, the children below or above the middle, which are most.
    std::uint32_t possible = (1u << (1 << kAxes)) - 1;
    constexpr std::uint32_t kLower[3] = {0x55, 0x33, 0x0F};  // children whose bit of the axis is 0
    for (int axis = 0; axis < kAxes; ++axis) {
      if (low_[axis] > middle[axis]) possible &= ~kLower[axis];
      if (high_[axis] < middle[axis]) possible &= kLower[axis];
    }
    const double quarter = 0.5 * half;
    for (; possible != 0; possible &= possible - 1) {
      const auto child = static_cast<std::uint32_t>(std::countr_zero(possible));
      Vec3 at = middle;
      for (int axis = 0; axis < kAxes; ++axis) at[axis] += (child >> axis & 1u) != 0 ? quarter : -quarter;
      if (touches(at, quarter) && !descend(first + child, at, quarter)) return false;
    }
    return true;
  }

  const Nodes& nodes_;
  Visit& visit_;
  geometry::SegmentProbe probe_;
  Vec3 reach_, low_, high_;
};

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
  /// The leaf whose box holds a point; none outside the root's.
  [[nodiscard]] const TreeNode* leaf_at(const Vec3& local_mm) const noexcept {
    std::int64_t cube[3] = {0, 0, 0};
    for (int axis = 0; axis < kAxes; ++axis) {
      cube[axis] = lattice_.coordinate(local_mm[axis], axis);
      if (static_cast<std::uint64_t>(cube[axis]) >> kMortonBits != 0) return nullptr;
    }
    std::uint32_t node = 0;
    for (int level = kMortonBits; nodes_[node].child != 0;)
      node = nodes_[node].child + child_of<kAxes>(cube, --level);
    return &nodes_[node];
  }

  /// visit(places) for every leaf that the segment, widened by `reach_mm`, touches: see Partition.
  template <class Visit>
  bool visit_segment(const Vec3& a_mm, const Vec3& b_mm, const Vec3& reach_mm, Visit& visit) const {
    return OrthtreeTraversal<kAxes, Visit>(nodes_, lattice_, a_mm, b_mm, reach_mm, visit).run();
  }

 private:
  Lattice lattice_;  ///< the root spans 2^kMortonBits of its cubes along each axis
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
  if (!is_finite(a_mm) || !is_finite(b_mm)) return true;
  return tree.visit_segment(a_mm, b_mm, reach_mm, visit);
}

template <int kAxes, class Visit>
bool visit_point_range(const Orthtree<kAxes>& tree, const Vec3& point_mm, Visit&& visit) {
  const TreeNode* leaf = tree.leaf_at(point_mm);
  return visit(leaf == nullptr ? IndexRange{} : IndexRange{leaf->begin, leaf->end});
}

static_assert(Partition<Octree> && Partition<Quadtree3d>);

}  // namespace palpate::search
