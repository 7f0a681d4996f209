// A balanced tree of axis-aligned boxes, the index for everything with a box (models, mesh facets).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <palpate/aabb.h>

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

}  // namespace palpate::geometry
