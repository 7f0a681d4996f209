#include "toolkit/search/dynamic_orthtree.h"

#include <algorithm>

namespace palpate::search {

template <int kAxes>
DynamicOrthtree<kAxes> DynamicOrthtree<kAxes>::build(const cloud::Cloud& cloud,
                                                     const PartitionOptions& options, int threads) {
  DynamicOrthtree tree;
  const Orthtree<kAxes> built = Orthtree<kAxes>::build(cloud, options, threads);
  tree.options_ = options;
  tree.last_level_ = kMortonBits - std::clamp(options.max_depth, 0, kMortonBits);
  tree.frame_ = built.frame();
  tree.order_.assign(built.order().begin(), built.order().end());
  tree.moved_ = MovedPoints(cloud.size());

  const std::size_t nodes = built.nodes().size();
  const std::size_t blocks =
      std::max(kMinSpare, static_cast<std::size_t>(options.spare * static_cast<double>(nodes / kChildren)));
  tree.nodes_.reserve(nodes + blocks * kChildren);
  tree.nodes_.assign(built.nodes().begin(), built.nodes().end());
  tree.nodes_.resize(nodes + blocks * kChildren);
  tree.states_.resize(tree.nodes_.size());
  tree.parents_.assign(blocks, kNone);
  tree.first_spare_ = static_cast<std::uint32_t>(nodes);
  for (std::size_t block = blocks; block-- > 0;)
    tree.give_block(static_cast<std::uint32_t>(nodes + block * kChildren));
  return tree;
}

template <int kAxes>
std::size_t DynamicOrthtree<kAxes>::bytes() const noexcept {
  return nodes_.capacity() * sizeof(TreeNode) + states_.capacity() * sizeof(LeafState) +
         parents_.capacity() * sizeof(std::uint32_t) + moved_.bytes() +
         order_.capacity() * sizeof(std::uint32_t);
}

template <int kAxes>
std::uint32_t DynamicOrthtree<kAxes>::take_block(std::uint32_t parent) noexcept {
  const std::uint32_t block = free_block_;
  free_block_ = nodes_[block].child;
  nodes_[block] = {};
  parent_of(block) = parent;
  --spare_left_;
  return block;
}

template <int kAxes>
void DynamicOrthtree<kAxes>::give_block(std::uint32_t block) noexcept {
  for (std::uint32_t child = 0; child < kChildren; ++child) {
    nodes_[block + child] = {};
    states_[block + child] = {};
  }
  nodes_[block].child = free_block_;
  free_block_ = block;
  ++spare_left_;
}

template <int kAxes>
bool DynamicOrthtree<kAxes>::grow_root(const Vec3& to_mm) noexcept {
  if (frame_.root_level == kMaxRootLevel || spare_left_ == 0) return false;
  // Grows towards the point: if it is below the root, the old root becomes the upper child.
  std::uint32_t child = 0;
  for (int axis = 0; axis < kAxes; ++axis) {
    if (frame_.coordinate(to_mm, axis) >= 0) continue;
    child |= 1u << axis;
    frame_.low[axis] -= std::int64_t{1} << frame_.root_level;
  }
  ++frame_.root_level;
  const std::uint32_t block = take_block(kNone);
  nodes_[block + child] = nodes_[0];
  states_[block + child] = states_[0];
  if (is_spare(nodes_[0].child) && parent_of(nodes_[0].child) != kNone)
    parent_of(nodes_[0].child) = block + child;
  nodes_[0].child = block;
  states_[0] = {};
  return true;
}

template <int kAxes>
void DynamicOrthtree<kAxes>::join_around(std::uint32_t leaf) noexcept {
  while (is_spare(leaf)) {
    const std::uint32_t block = leaf - (leaf - first_spare_) % kChildren;
    const std::uint32_t parent = parent_of(block);
    if (parent == kNone) return;
    std::uint32_t together = 0;
    for (std::uint32_t child = block; child < block + kChildren; ++child) {
      if (nodes_[child].child != 0) return;
      together += states_[child].listed;
    }
    if (together > options_.max_points / 2) return;
    nodes_[parent].child = 0;
    for (std::uint32_t child = block; child < block + kChildren; ++child)
      while (states_[child].head != kNone) {
        const std::uint32_t place = states_[child].head;
        moved_.leave(states_[child], place);
        moved_.enter(states_[parent], home(parent), place);
      }
    give_block(block);
    leaf = parent;
  }
}

template <int kAxes>
LeafStatistics DynamicOrthtree<kAxes>::statistics() const {
  LeafStatistics found;
  struct Entry {
    std::uint32_t node;
    int depth;
  };
  std::vector<Entry> open{{0, 0}};
  std::size_t points = 0;
  while (!open.empty()) {
    const Entry at = open.back();
    open.pop_back();
    ++found.nodes;
    const std::uint32_t first = nodes_[at.node].child;
    if (first != 0) {
      for (std::uint32_t child = 0; child < kChildren; ++child) open.push_back({first + child, at.depth + 1});
      continue;
    }
    const std::uint32_t here = population(at.node);
    if (here == 0) continue;
    ++found.leaves;
    points += here;
    found.max_points = std::max(found.max_points, here);
    found.max_depth = std::max(found.max_depth, at.depth);
  }
  if (found.leaves > 0) found.mean_points = static_cast<double>(points) / static_cast<double>(found.leaves);
  return found;
}

template class DynamicOrthtree<2>;
template class DynamicOrthtree<3>;

}  // namespace palpate::search
