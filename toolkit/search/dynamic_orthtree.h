// Octree and 3D quadtree under deformation: leaves split and merge as points move.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <span>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/search/moved_points.h"
#include "toolkit/search/orthtree.h"

namespace palpate::search {

/// An Orthtree with moving points (see DynamicPartition). A leaf above `max_points` splits, once a move, with
/// children from a pool; pool children merge when they hold at most half as many together. A point outside
/// the root enlarges it, one pool block per doubling. With an empty pool leaves exceed `max_points`, which
/// costs time only; a new root without a block, or beyond 2^40 cubes, gives kFull. Extra memory: 8 1/8 bytes
/// a point, 12 a node.
template <int kAxes>
class DynamicOrthtree {
 public:
  static constexpr std::uint32_t kChildren = 1u << kAxes;
  /// Least number of spare blocks: a root may double twenty times and leaves still split.
  static constexpr std::size_t kMinSpare = 64;
  /// A leaf over this many times `max_points` (no spare nodes, or coincident points) no longer splits, which
  /// bounds a move's work.
  static constexpr std::uint32_t kMaxDivided = 8;

  [[nodiscard]] static DynamicOrthtree build(const cloud::Cloud& cloud, const PartitionOptions& options,
                                             int threads);

  [[nodiscard]] std::span<const std::uint32_t> order() const noexcept { return order_; }
  void drop_order() noexcept { std::vector<std::uint32_t>().swap(order_); }
  [[nodiscard]] std::size_t bytes() const noexcept;
  [[nodiscard]] LeafStatistics statistics() const;
  /// Number of unused spare blocks.
  [[nodiscard]] std::size_t spare_left() const noexcept { return spare_left_; }

  template <class At>
  [[nodiscard]] MoveStatus move(std::uint32_t place, const Vec3f& to_mm, const At& at) noexcept {
    const Vec3 from = widened(at(place)), to = widened(to_mm);
    if (!reach(to)) return MoveStatus::kFull;
    const LeafAt source = leaf_at<kAxes>(nodes_, frame_, from);
    if (same_box(from, to, source.level)) return MoveStatus::kStays;
    moved_.leave(states_[source.node], place);
    join_around(source.node);
    enter_leaf(place, to, at);
    return MoveStatus::kMoved;
  }

  [[nodiscard]] const LargePageVector<TreeNode>& nodes() const noexcept { return nodes_; }
  [[nodiscard]] const TreeFrame& frame() const noexcept { return frame_; }

  template <class Visit>
  bool visit_leaf(std::uint32_t node, Visit&& visit) const {
    return moved_.visit(states_[node], home(node), visit);
  }

 private:
  static constexpr std::uint32_t kNone = LeafState::kNone;

  [[nodiscard]] IndexRange home(std::uint32_t node) const noexcept {
    return {nodes_[node].begin, nodes_[node].end};
  }
  [[nodiscard]] std::uint32_t population(std::uint32_t node) const noexcept {
    return nodes_[node].end - nodes_[node].begin - states_[node].away + states_[node].listed;
  }
  [[nodiscard]] bool same_box(const Vec3& a_mm, const Vec3& b_mm, int level) const noexcept {
    for (int axis = 0; axis < kAxes; ++axis)
      if (frame_.coordinate(a_mm, axis) >> level != frame_.coordinate(b_mm, axis) >> level) return false;
    return true;
  }
  /// True within the largest root; false for NaN.
  [[nodiscard]] bool is_near(const Vec3& p_mm) const noexcept {
    for (int axis = 0; axis < kAxes; ++axis)
      if (std::abs(frame_.lattice.coordinate(p_mm[axis], axis)) >= std::int64_t{1} << kMaxRootLevel)
        return false;
    return true;
  }
  [[nodiscard]] bool may_divide(const LeafAt& leaf) const noexcept {
    const std::uint32_t here = population(leaf.node);
    return here > options_.max_points && here <= kMaxDivided * options_.max_points &&
           nodes_[leaf.node].end - nodes_[leaf.node].begin <= kMaxDivided * options_.max_points &&
           leaf.level > last_level_ && spare_left_ > 0;
  }
  [[nodiscard]] bool is_spare(std::uint32_t node) const noexcept { return node >= first_spare_; }
  [[nodiscard]] std::uint32_t& parent_of(std::uint32_t spare_node) noexcept {
    return parents_[(spare_node - first_spare_) / kChildren];
  }

  /// Enlarges the root to hold a point; false if impossible.
  bool reach(const Vec3& to_mm) noexcept {
    if (!is_near(to_mm)) return false;
    while (!frame_.holds<kAxes>(to_mm))
      if (!grow_root(to_mm)) return false;
    return true;
  }
  /// For a place in no leaf; the root holds `to_mm`.
  template <class At>
  void enter_leaf(std::uint32_t place, const Vec3& to_mm, const At& at) noexcept {
    const LeafAt target = leaf_at<kAxes>(nodes_, frame_, to_mm);
    moved_.enter(states_[target.node], home(target.node), place);
    if (may_divide(target))
      divide(target, [&](std::uint32_t other) { return other == place ? to_mm : widened(at(other)); });
  }
  /// Takes a block of empty leaves from the pool, which must not be empty.
  std::uint32_t take_block(std::uint32_t parent) noexcept;
  void give_block(std::uint32_t block) noexcept;
  bool grow_root(const Vec3& to_mm) noexcept;
  /// Merges the leaf's block, then its ancestors', while they hold few enough.
  void join_around(std::uint32_t leaf) noexcept;

  /// Distributes a leaf's places to new children: at most kMaxDivided x max_points.
  template <class At>
  void divide(const LeafAt& leaf, const At& at) noexcept {
    const std::uint32_t block = take_block(leaf.node);
    LeafState& state = states_[leaf.node];
    const auto hand_down = [&](std::uint32_t place) {
      const Vec3 p = at(place);
      std::int64_t cube[3] = {0, 0, 0};
      for (int axis = 0; axis < kAxes; ++axis) cube[axis] = frame_.coordinate(p, axis);
      moved_.leave(state, place);
      moved_.enter(states_[block + child_of<kAxes>(cube, leaf.level - 1)], {}, place);
    };
    const IndexRange own = home(leaf.node);
    for (std::uint32_t place = own.begin; place < own.end && state.away < own.end - own.begin; ++place)
      if (!moved_.is_away(place)) hand_down(place);
    while (state.head != kNone) hand_down(state.head);
    nodes_[leaf.node].child = block;
  }

  PartitionOptions options_;
  int last_level_ = 0;
  TreeFrame frame_;
  LargePageVector<TreeNode> nodes_;  ///< as built, then the pool; a free block's first node links to the next
  LargePageVector<LeafState> states_;
  LargePageVector<std::uint32_t> parents_;  ///< by pool block; kNone: a block under a grown root
  std::uint32_t first_spare_ = 0, free_block_ = 0;
  std::size_t spare_left_ = 0;
  MovedPoints moved_;
  std::vector<std::uint32_t> order_;
};

using DynamicOctree = DynamicOrthtree<3>;
using DynamicQuadtree3d = DynamicOrthtree<2>;

extern template class DynamicOrthtree<2>;
extern template class DynamicOrthtree<3>;

template <int kAxes, class Visit>
bool visit_segment_ranges(const DynamicOrthtree<kAxes>& tree, const Vec3& a_mm, const Vec3& b_mm,
                          const Vec3& reach_mm, Visit&& visit) {
  return visit_leaves<kAxes>(tree.nodes(), tree.frame(), a_mm, b_mm, reach_mm,
                             [&](std::uint32_t node) { return tree.visit_leaf(node, visit); });
}

template <int kAxes, class Visit>
bool visit_point_range(const DynamicOrthtree<kAxes>& tree, const Vec3& point_mm, Visit&& visit) {
  if (!tree.frame().template holds<kAxes>(point_mm)) return true;
  return tree.visit_leaf(leaf_at<kAxes>(tree.nodes(), tree.frame(), point_mm).node, visit);
}

static_assert(DynamicPartition<DynamicOctree> && DynamicPartition<DynamicQuadtree3d>);

}  // namespace palpate::search
