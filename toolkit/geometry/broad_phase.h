// A balanced tree of boxes, and the broad phase. The tree indexes everything with a box (models, mesh
// facets). The broad phase of collision detection finds the boxes near the probe: the slow loop of the
// four-rate structure in section 2.2.4 of the thesis.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <palpate/geometry.h>

namespace palpate::geometry {

/// Items are numbered 0 to size() - 1 and known by their boxes only. Empty and NaN boxes are never met;
/// infinite ones always are. Each level halves the count along the axis on which centres are widest apart,
/// ties by number: deterministic, depth at most log2(size) + 1 for any boxes, equal ones included. Building
/// O(n log n), refitting O(n); only the constructor allocates. Concurrent reads are safe while nothing is
/// refitted.
class AabbTree {
 public:
  using BoxOf = std::function<Aabb(std::uint32_t item)>;

  AabbTree() = default;
  /// `leaf_items` boxes share a leaf: trades memory (64 bytes a node) against tests.
  AabbTree(std::uint32_t items, const BoxOf& box_of, std::uint32_t leaf_items = 1);

  [[nodiscard]] std::uint32_t size() const noexcept { return static_cast<std::uint32_t>(order_.size()); }
  [[nodiscard]] std::size_t bytes() const noexcept;

  /// Refits the same tree to moved boxes; box_of must not throw.
  void refit(const BoxOf& box_of) noexcept;
  /// Rebuilds the tree of the same items in the same memory.
  void rebuild(const BoxOf& box_of) noexcept;
  /// Growth of the inner nodes' surface since building, 1 just after it; visits cost about that factor. 1
  /// where undefined (no inner nodes, infinite or flat boxes).
  [[nodiscard]] double growth() const noexcept;

  /// Calls item(i) for the items of every leaf for whose box and ancestors meets(box) holds, left to right.
  template <class Meets, class Item>
  void visit(const Meets& meets, const Item& item) const;

  /// Calls item(i) for items in leaves with key(box) <= bound, roughly nearest first. item(i) returns the
  /// next bound; `bound` is the first. key(box) must not exceed the key of anything inside.
  template <class Key, class Item>
  void visit_nearest(const Key& key, double bound, const Item& item) const;

 private:
  struct Node {
    Aabb box;
    std::uint32_t begin = 0, end = 0;  ///< its items in order_
    std::uint32_t right = 0;           ///< second child of an inner node (the first follows the node); 0 in a
                                       ///< leaf
  };
  /// Stack of a visit: one node a level, and 2^32 items have 33 levels.
  static constexpr std::size_t kStack = 34;
  struct Waiting {
    std::uint32_t node;
    double key;
  };

  void build(const BoxOf& box_of) noexcept;
  std::uint32_t split(std::uint32_t begin, std::uint32_t end) noexcept;
  [[nodiscard]] double inner_surface_area() const noexcept;

  std::uint32_t leaf_items_ = 1;
  double built_surface_area_ = 0.0;
  std::vector<Node> nodes_;  // parents before children
  std::vector<std::uint32_t> order_;
  std::vector<Vec3> centres_;  // by item, for rebuilding
};

template <class Meets, class Item>
void AabbTree::visit(const Meets& meets, const Item& item) const {
  if (nodes_.empty()) return;
  std::array<std::uint32_t, kStack> stack;
  std::size_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const std::uint32_t at = stack[--depth];
    const Node& node = nodes_[at];
    if (!meets(node.box)) continue;
    if (node.right != 0) {
      stack[depth++] = node.right;
      stack[depth++] = at + 1;
      continue;
    }
    for (std::uint32_t i = node.begin; i < node.end; ++i) item(order_[i]);
  }
}

template <class Key, class Item>
void AabbTree::visit_nearest(const Key& key, double bound, const Item& item) const {
  if (nodes_.empty()) return;
  std::array<Waiting, kStack> stack;
  std::size_t depth = 0;
  stack[depth++] = {0, key(nodes_[0].box)};
  while (depth > 0) {
    const Waiting at = stack[--depth];
    if (!(at.key <= bound)) continue;
    const Node& node = nodes_[at.node];
    if (node.right == 0) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) bound = item(order_[i]);
      continue;
    }
    Waiting near{at.node + 1, key(nodes_[at.node + 1].box)}, far{node.right, key(nodes_[node.right].box)};
    if (far.key < near.key) std::swap(near, far);
    stack[depth++] = far;
    stack[depth++] = near;
  }
}

/// One box found by a query.
struct BoxHit {
  std::uint32_t item = 0;
  double distance_sq_mm2 = 0.0;  ///< from the query's centre to the box, 0 inside
};

/// A query's result besides its hits.
struct BoxQuery {
  std::uint32_t hits = 0;      ///< written to the front of the list
  std::uint32_t left_out = 0;  ///< also met, but farther than all hits of a full list
  std::uint32_t nodes = 0;     ///< tree nodes visited
};

/// The moving boxes of a scene's models. Only the constructor allocates. One thread updates; concurrent const
/// calls are safe between updates.
class BroadPhase {
 public:
  /// A refitted tree is rebuilt beyond this growth of surface: it visits about twice the nodes, and
  /// rebuilding costs some ten refits.
  static constexpr double kRebuildAreaRatio = 2.0;

  BroadPhase() = default;
  /// World frame, one box per item; empty and NaN boxes are never found.
  explicit BroadPhase(std::span<const Aabb> boxes);

  /// Moves the boxes; their number must not change (asserted). O(n), at times O(n log n).
  void update(std::span<const Aabb> boxes) noexcept;

  /// Finds boxes that meet `region` (touching included), sorted by distance to its centre, ties by number. A
  /// full `list` keeps the nearest and counts the rest. The result does not depend on the tree's history.
  /// Visits at most 2 n nodes, usually O(log n + hits); each hit moves at most list.size() entries.
  BoxQuery query(const Aabb& region, std::span<BoxHit> list) const noexcept;
  /// All boxes that meet `region`, by rising number. `out` must have room for all.
  void within(const Aabb& region, std::vector<std::uint32_t>& out) const noexcept;
  /// The same for boxes within `reach_mm`, along each axis, of the segment. On long ways these are far fewer
  /// than in the box around the way.
  void along_segment(const Vec3& from_mm, const Vec3& to_mm, double reach_mm,
                     std::vector<std::uint32_t>& out) const noexcept;

  [[nodiscard]] std::uint32_t size() const noexcept { return tree_.size(); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return tree_.bytes() + boxes_.capacity() * sizeof(Aabb);
  }
  [[nodiscard]] std::uint64_t rebuilds() const noexcept { return rebuilds_; }

 private:
  AabbTree tree_;
  std::vector<Aabb> boxes_;
  std::uint64_t rebuilds_ = 0;
};

}  // namespace palpate::geometry
