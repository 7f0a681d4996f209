// The octree and the 3D quadtree under deformation: leaves divide and join as points pass through them.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <span>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/partition/moved_places.h"
#include "toolkit/partition/space_tree.h"

namespace palpate::partition {

/// A SpaceTree whose points move (see DynamicPartition). A leaf that gets more than `max_points` divides once
/// a move, with children from a pool; children of the pool that hold no more than half as many together join
/// again. A point outside the root gets a larger root around it, one block of the pool for each doubling.
/// When the pool is empty leaves grow beyond `max_points`, which costs time and no point; only a new root
/// must have its block: then, or beyond 2^40 cubes of the lattice, kFull. Memory beside the tree's: 8 1/8
/// bytes a point, 12 a node.
template <int kAxes>
class DynamicTree {
 public:
  static constexpr std::uint32_t kChildren = 1u << kAxes;
  /// At least this many spare blocks of children: a root may double twenty times and leaves still divide.
  static constexpr std::size_t kLeastSpare = 64;
  /// A leaf grown beyond this many times `max_points`, for want of spare nodes or because its points
  /// coincide, is not divided any more: a move must not have to sort a crowd.
  static constexpr std::uint32_t kMostDivided = 8;

  [[nodiscard]] static DynamicTree build(const cloud::Cloud& cloud, const PartitionOptions& options,
                                         int threads);

  [[nodiscard]] std::span<const std::uint32_t> order() const noexcept { return order_; }
  void drop_order() noexcept { std::vector<std::uint32_t>().swap(order_); }
  [[nodiscard]] std::size_t bytes() const noexcept;
  [[nodiscard]] LeafStatistics statistics() const;
  /// Spare blocks of children not in use.
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
  template <class At>
  [[nodiscard]] MoveStatus add(std::uint32_t place, const Vec3f& at_mm, const At& at) noexcept {
    const Vec3 to = widened(at_mm);
    if (place >= moved_.places() || !reach(to)) return MoveStatus::kFull;
    moved_.add(place);
    enter_leaf(place, to, at);
    return MoveStatus::kMoved;
  }
  void remove(std::uint32_t place, const Vec3f& at_mm) noexcept {
    const std::uint32_t leaf = leaf_at<kAxes>(nodes_, frame_, widened(at_mm)).node;
    moved_.leave(states_[leaf], place);
    join_around(leaf);
  }

  [[nodiscard]] const LargeVector<TreeNode>& nodes() const noexcept { return nodes_; }
  [[nodiscard]] const TreeFrame& frame() const noexcept { return frame_; }

  template <class Visit>
  bool visit_leaf(std::uint32_t node, Visit&& visit) const {
    return moved_.visit(states_[node], home(node), visit);
  }

 private:
  static constexpr std::uint32_t kNone = LeafState::kNone;

  [[nodiscard]] PlaceRange home(std::uint32_t node) const noexcept {
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
  /// Within what a root can grow to; not so for a number that is none.
  [[nodiscard]] bool is_near(const Vec3& p_mm) const noexcept {
    for (int axis = 0; axis < kAxes; ++axis)
      if (std::abs(frame_.lattice.coordinate(p_mm[axis], axis)) >= std::int64_t{1} << kMaxRootLevel)
        return false;
    return true;
  }
  [[nodiscard]] bool may_divide(const LeafAt& leaf) const noexcept {
    const std::uint32_t here = population(leaf.node);
    return here > options_.max_points && here <= kMostDivided * options_.max_points &&
           nodes_[leaf.node].end - nodes_[leaf.node].begin <= kMostDivided * options_.max_points &&
           leaf.level > last_level_ && spare_left_ > 0;
  }
  [[nodiscard]] bool is_spare(std::uint32_t node) const noexcept { return node >= first_spare_; }
  [[nodiscard]] std::uint32_t& parent_of(std::uint32_t spare_node) noexcept {
    return parents_[(spare_node - first_spare_) / kChildren];
  }

  /// Makes the root hold a point; false where it cannot.
  bool reach(const Vec3& to_mm) noexcept {
    if (!is_near(to_mm)) return false;
    while (!frame_.holds<kAxes>(to_mm))
      if (!grow_root(to_mm)) return false;
    return true;
  }
  /// Of a place that is in no leaf; the root holds `to_mm`.
  template <class At>
  void enter_leaf(std::uint32_t place, const Vec3& to_mm, const At& at) noexcept {
    const LeafAt target = leaf_at<kAxes>(nodes_, frame_, to_mm);
    moved_.enter(states_[target.node], home(target.node), place);
    if (may_divide(target))
      divide(target, [&](std::uint32_t other) { return other == place ? to_mm : widened(at(other)); });
  }
  /// Takes a block of empty leaves from the pool; there must be one.
  std::uint32_t take_block(std::uint32_t parent) noexcept;
  void give_block(std::uint32_t block) noexcept;
  bool grow_root(const Vec3& to_mm) noexcept;
  /// Joins the leaf's block, and then its parent's, while they hold few enough.
  void join_around(std::uint32_t leaf) noexcept;

  /// Hands all places of a leaf to new children: at most kMostDivided x max_points.
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
    const PlaceRange own = home(leaf.node);
    for (std::uint32_t place = own.begin; place < own.end && state.away < own.end - own.begin; ++place)
      if (!moved_.is_away(place)) hand_down(place);
    while (state.head != kNone) hand_down(state.head);
    nodes_[leaf.node].child = block;
  }

  PartitionOptions options_;
  int last_level_ = 0;
  TreeFrame frame_;
  LargeVector<TreeNode> nodes_;  ///< as built, then the pool; a free block's first node links to the next
  LargeVector<LeafState> states_;
  LargeVector<std::uint32_t> parents_;  ///< by block of the pool; kNone: a block under a grown root
  std::uint32_t first_spare_ = 0, free_block_ = 0;
  std::size_t spare_left_ = 0;
  MovedPlaces moved_;
  std::vector<std::uint32_t> order_;
};

using DynamicOctree = DynamicTree<3>;
using DynamicQuadtree3d = DynamicTree<2>;

extern template class DynamicTree<2>;
extern template class DynamicTree<3>;

template <int kAxes, class Visit>
bool visit_ranges(const DynamicTree<kAxes>& tree, const Vec3& a_mm, const Vec3& b_mm, const Vec3& reach_mm,
                  Visit&& visit) {
  return visit_leaves<kAxes>(tree.nodes(), tree.frame(), a_mm, b_mm, reach_mm,
                             [&](std::uint32_t node) { return tree.visit_leaf(node, visit); });
}

template <int kAxes, class Visit>
bool visit_at(const DynamicTree<kAxes>& tree, const Vec3& point_mm, Visit&& visit) {
  if (!tree.frame().template holds<kAxes>(point_mm)) return true;
  return tree.visit_leaf(leaf_at<kAxes>(tree.nodes(), tree.frame(), point_mm).node, visit);
}

static_assert(DynamicPartition<DynamicOctree> && DynamicPartition<DynamicQuadtree3d>);

}  // namespace palpate::partition
