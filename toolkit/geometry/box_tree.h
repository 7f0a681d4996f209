// A balanced tree of axis-aligned boxes: the one index over things that have a box (models of a scene, facets
// of a mesh).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "toolkit/geometry/aabb.h"

namespace palpate::geometry {

/// Items are numbered from 0 to size() - 1; nothing is known of them but their boxes. A box that is empty or
/// has a NaN is never met; an infinite one is met by everything. The count is halved at every level along the
/// axis on which the centres lie widest apart, ties by number: deterministic, depth at most
/// log2(size) + 1 whatever the boxes, also where all are the same. Building O(n log n), refitting O(n);
/// only the constructor allocates. Reading is safe from many threads while nothing is refitted.
class BoxTree {
 public:
  using BoxOf = std::function<Aabb(std::uint32_t item)>;

  BoxTree() = default;
  /// `leaf_items` boxes share one leaf: memory against tests (64 bytes a node).
  BoxTree(std::uint32_t items, const BoxOf& box_of, std::uint32_t leaf_items = 1);

  [[nodiscard]] std::uint32_t size() const noexcept { return static_cast<std::uint32_t>(order_.size()); }
  [[nodiscard]] std::size_t bytes() const noexcept;

  /// The same tree around boxes that moved; box_of must not throw.
  void refit(const BoxOf& box_of) noexcept;
  /// A new tree of the same items in the same memory.
  void rebuild(const BoxOf& box_of) noexcept;
  /// How much more surface the boxes of the inner nodes have than when the tree was built, 1 just after
  /// building. A refitted tree is visited in about so many times more nodes. 1 where it means nothing (no
  /// inner nodes, infinite or flat boxes).
  [[nodiscard]] double growth() const noexcept;

  /// Calls item(i) for every item of every leaf whose box, and all boxes above it, satisfy meets(box). Left
  /// to right.
  template <class Meets, class Item>
  void visit(const Meets& meets, const Item& item) const;

  /// Calls item(i), nearer boxes first by and large, for every item in leaves with key(box) at most the
  /// bound; the bound is what item(i) returned last, at first `bound`. key(box) must not be above the key of
  /// anything inside.
  template <class Key, class Item>
  void visit_nearest(const Key& key, double bound, const Item& item) const;

 private:
  struct Node {
    Aabb box;
    std::uint32_t begin = 0, end = 0;  ///< its items in order_
    std::uint32_t right = 0;           ///< second child of an inner node, the first follows; 0 in a leaf
  };
  /// Waiting nodes of a visit: one a level, and 2^32 items have 33 levels.
  static constexpr std::size_t kStack = 34;
  struct Waiting {
    std::uint32_t node;
    double key;
  };

  void build(const BoxOf& box_of) noexcept;
  std::uint32_t split(std::uint32_t begin, std::uint32_t end) noexcept;
  [[nodiscard]] double inner_surface() const noexcept;

  std::uint32_t leaf_items_ = 1;
  double built_surface_ = 0.0;
  std::vector<Node> nodes_;  // parents before children
  std::vector<std::uint32_t> order_;
  std::vector<Vec3> centres_;  // for rebuilding, by item
};

template <class Meets, class Item>
void BoxTree::visit(const Meets& meets, const Item& item) const {
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
void BoxTree::visit_nearest(const Key& key, double bound, const Item& item) const {
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

}  // namespace palpate::geometry
