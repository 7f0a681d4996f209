// Partitions of moving points: the uniform grid under deformation (section 3.1.2.3), including points that
// leave the first box, and the octree and 3D quadtree, whose leaves split and merge as points move.
#pragma once

#include <bit>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <vector>

#include "toolkit/core/hardware.h"
#include "toolkit/search/orthtree.h"
#include "toolkit/search/partition.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::search {

/// A stored point in double, exactly. In a separate translation unit on purpose: if both conversions double
/// -> float -> double are in one function, GCC 12 at -O2 vectorises them away (for three components), and a
/// point would be searched a rounding beside its stored place.
[[nodiscard]] Vec3 widened(const Vec3f& stored) noexcept;

/// The result of moving a point.
enum class MoveStatus : std::uint8_t {
  kStays,  ///< in its leaf: nothing changed
  kMoved,
  kFull,  ///< no spare room, or too far: nothing changed, and the point must stay
};

namespace detail {
/// Any function from a place to its position.
struct AnyPositions {
  Vec3f operator()(std::uint32_t) const noexcept { return Vec3f::Zero(); }
};
}  // namespace detail

/// A partition of moving points, also out of the cloud's first box. The owner stores the points as floats:
/// p.move(place, to, at) asks at(place) for positions, in which `to` is not yet applied, and stores none.
/// After any result but kFull the owner stores `to`. Non-finite points are refused as too far. Places keep
/// their numbers; a place far from its leaf's others is its own range, so each still comes at most once. move
/// allocates nothing; its work is bounded by the depth and a leaf's points. Must not be read during a move.
template <class P>
concept DynamicPartition = Partition<P> && requires(P& p, const Vec3f& to_mm, detail::AnyPositions at) {
  { p.move(0u, to_mm, at) }
  noexcept->std::same_as<MoveStatus>;
  { p.spare_left() } -> std::same_as<std::size_t>;
};

/// A leaf's state in a moving partition, besides its range.
struct LeafState {
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  std::uint32_t head = kNone;  ///< first place of the list
  std::uint32_t listed = 0;    ///< length of the list
  std::uint32_t away = 0;      ///< places of the own range that are listed elsewhere
};

/// A doubly linked list per leaf, stored as two numbers a place: any place can be removed, and no pool runs
/// out. 8 1/8 bytes a point. O(1) except visit.
class MovedPoints {
 public:
  explicit MovedPoints(std::size_t places = 0) : links_(places), away_((places + 63) / 64, 0) {}

  [[nodiscard]] bool is_away(std::uint32_t place) const noexcept {
    return (away_[place / 64] >> (place % 64) & 1u) != 0;
  }

  /// Adds a place to a leaf with range `home`: back into the range, or to the list.
  void enter(LeafState& leaf, IndexRange home, std::uint32_t place) noexcept {
    if (home.begin <= place && place < home.end) {
      away_[place / 64] &= ~(std::uint64_t{1} << place % 64);
      --leaf.away;
      return;
    }
    links_[place] = {LeafState::kNone, leaf.head};
    if (leaf.head != LeafState::kNone) links_[leaf.head].before = place;
    leaf.head = place;
    ++leaf.listed;
  }
  /// Removes a place from its leaf; it must enter another.
  void leave(LeafState& leaf, std::uint32_t place) noexcept {
    if (!is_away(place)) {
      away_[place / 64] |= std::uint64_t{1} << place % 64;
      ++leaf.away;
      return;
    }
    const Link link = links_[place];
    if (link.before != LeafState::kNone)
      links_[link.before].after = link.after;
    else
      leaf.head = link.after;
    if (link.after != LeafState::kNone) links_[link.after].before = link.before;
    --leaf.listed;
  }

  /// Calls visit(range) for all places of a leaf: its remaining range in runs, then the list.
  template <class Visit>
  bool visit(const LeafState& leaf, IndexRange home, Visit&& visit) const {
    if (leaf.away == 0) {
      if (!home.empty() && !visit(home)) return false;
    } else {
      for (std::uint32_t at = home.begin; at < home.end;) {
        const std::uint32_t run = run_end(at, home.end);
        if (run > at && !visit(IndexRange{at, run})) return false;
        at = run + 1;
      }
    }
    for (std::uint32_t place = leaf.head; place != LeafState::kNone; place = links_[place].after)
      if (!visit(IndexRange{place, place + 1})) return false;
    return true;
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return links_.capacity() * sizeof(Link) + away_.capacity() * sizeof(std::uint64_t);
  }

 private:
  struct Link {
    std::uint32_t before = LeafState::kNone, after = LeafState::kNone;
  };
  /// The first place from `at` that is away, at most `end`.
  [[nodiscard]] std::uint32_t run_end(std::uint32_t at, std::uint32_t end) const noexcept {
    while (at < end) {
      const std::uint64_t rest = away_[at / 64] >> at % 64;
      if (rest != 0) return std::min(end, at + static_cast<std::uint32_t>(std::countr_zero(rest)));
      at = (at / 64 + 1) * 64;
    }
    return end;
  }

  LargePageVector<Link> links_;
  LargePageVector<std::uint64_t> away_;
};

/// A uniform grid with moving points (see DynamicPartition). Cells empty at build come from a table of spare
/// cells and return to it; they may lie within 2^31 cells of the first box. kFull: no spare cells, or the
/// point is farther away. A move looks up two cells. Extra memory: 8 1/8 bytes a point, 12 a slot, 32 a spare
/// cell.
class DynamicGrid {
 public:
  /// Least number of spare cells, so that small clouds can move too.
  static constexpr std::size_t kMinSpare = 64;

  [[nodiscard]] static DynamicGrid build(const cloud::Cloud& cloud, const PartitionOptions& options,
                                         int threads);

  [[nodiscard]] std::span<const std::uint32_t> order() const noexcept { return grid_.order(); }
  void drop_order() noexcept { grid_.drop_order(); }
  [[nodiscard]] double cell_mm() const noexcept { return grid_.cell_mm(); }
  [[nodiscard]] std::size_t bytes() const noexcept;
  [[nodiscard]] LeafStatistics statistics() const noexcept;
  /// Number of unused spare cells.
  [[nodiscard]] std::size_t spare_left() const noexcept { return most_ - used_; }

  template <class At>
  [[nodiscard]] MoveStatus move(std::uint32_t place, const Vec3f& to_mm, const At& at) noexcept {
    const Cell from = grid_.cell_of(widened(at(place))), to = grid_.cell_of(widened(to_mm));
    if (from.x == to.x && from.y == to.y && from.z == to.z) return MoveStatus::kStays;
    return change_cell(place, from, to);
  }

  /// The box of all cells ever occupied.
  [[nodiscard]] const CellRange& box() const noexcept { return box_; }
  [[nodiscard]] const Lattice& lattice() const noexcept { return grid_.lattice(); }
  [[nodiscard]] Cell cell_of(const Vec3& local_mm) const noexcept { return grid_.cell_of(local_mm); }

  template <class Visit>
  bool visit_cell(const Cell& cell, Visit&& visit) const {
    const std::size_t slot = grid_.slot_of(cell);
    if (slot != UniformGrid::kNoSlot) return moved_.visit(states_[slot], grid_.places_of(slot), visit);
    if (used_ == 0) return true;
    const SpareCell& spare = spare_[find_spare(cell)];
    return spare.leaf.listed == 0 || moved_.visit(spare.leaf, {}, visit);
  }

 private:
  struct SpareCell {
    std::int32_t x = 0, y = 0, z = 0;
    LeafState leaf;  ///< listed == 0: a free slot
  };

  [[nodiscard]] MoveStatus change_cell(std::uint32_t place, const Cell& from, const Cell& to) noexcept;
  [[nodiscard]] bool has_room(const Cell& cell) const noexcept;
  void leave_cell(std::uint32_t place, const Cell& cell) noexcept;
  void enter_cell(std::uint32_t place, const Cell& cell) noexcept;
  /// The slot of a used spare cell, or the free one where it would go.
  [[nodiscard]] std::size_t find_spare(const Cell& cell) const noexcept;
  [[nodiscard]] std::size_t first_slot(std::int64_t x, std::int64_t y, std::int64_t z) const noexcept;
  void free_spare(std::size_t at) noexcept;

  UniformGrid grid_;
  MovedPoints moved_;
  LargePageVector<LeafState> states_;  ///< by slot of the grid
  LargePageVector<SpareCell> spare_;   ///< open addressing, linear probing, at most half full
  std::size_t most_ = 0, used_ = 0;
  int shift_ = 0;
  CellRange box_;
};

template <class Visit>
bool visit_segment_ranges(const DynamicGrid& grid, const Vec3& a_mm, const Vec3& b_mm, const Vec3& reach_mm,
                          Visit&& visit) {
  if (!is_finite(a_mm) || !is_finite(b_mm)) return true;
  return visit_cells(grid.lattice(), grid.box(), a_mm, b_mm, reach_mm,
                     [&](const Cell& cell) { return grid.visit_cell(cell, visit); });
}

template <class Visit>
bool visit_point_range(const DynamicGrid& grid, const Vec3& point_mm, Visit&& visit) {
  return grid.visit_cell(grid.cell_of(point_mm), visit);
}

static_assert(DynamicPartition<DynamicGrid>);

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
