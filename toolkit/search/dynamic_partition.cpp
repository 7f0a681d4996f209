#include "toolkit/search/dynamic_partition.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "toolkit/core/hash.h"

namespace palpate::search {

Vec3 widened(const Vec3f& stored) noexcept {
  return stored.cast<double>();
}

namespace {

/// Largest cell distance from the first box; coordinates are stored in 32 bits.
constexpr std::int64_t kFarCell = (std::int64_t{1} << 31) - 1;

/// Fibonacci hashing for x; two more odd constants mix the axes (Steele, Lea and Flood 2014).
constexpr std::uint64_t kMixY = 0xBF58476D1CE4E5B9u;
constexpr std::uint64_t kMixZ = 0x94D049BB133111EBu;

bool is_near(const Cell& cell) noexcept {
  const auto near = [](std::int64_t c) { return -kFarCell <= c && c <= kFarCell; };
  return near(cell.x) && near(cell.y) && near(cell.z);
}

}  // namespace

DynamicGrid DynamicGrid::build(const cloud::Cloud& cloud, const PartitionOptions& options, int threads) {
  DynamicGrid grid;
  grid.grid_ = UniformGrid::build(cloud, options.cell_mm, threads);
  grid.moved_ = MovedPoints(cloud.size());
  grid.states_.resize(grid.grid_.slots());
  grid.most_ = std::max(
      kMinSpare, static_cast<std::size_t>(options.spare * static_cast<double>(grid.grid_.occupied_cells())));
  grid.spare_.resize(std::bit_ceil(2 * grid.most_));
  grid.shift_ = 64 - std::countr_zero(grid.spare_.size());
  grid.box_.last = Vec3::Constant(static_cast<double>(grid.grid_.last_cell()));
  return grid;
}

std::size_t DynamicGrid::bytes() const noexcept {
  return grid_.bytes() + moved_.bytes() + states_.capacity() * sizeof(LeafState) +
         spare_.capacity() * sizeof(SpareCell);
}

LeafStatistics DynamicGrid::statistics() const noexcept {
  LeafStatistics found;
  found.nodes = states_.size() + spare_.size();
  std::size_t points = 0;
  const auto count = [&](std::uint32_t here) {
    found.leaves += here > 0;
    points += here;
    found.max_points = std::max(found.max_points, here);
  };
  for (std::size_t slot = 0; slot < states_.size(); ++slot) {
    const IndexRange home = grid_.places_of(slot);
    count(home.end - home.begin - states_[slot].away + states_[slot].listed);
  }
  for (const SpareCell& cell : spare_) count(cell.leaf.listed);
  if (found.leaves > 0) found.mean_points = static_cast<double>(points) / static_cast<double>(found.leaves);
  return found;
}

std::size_t DynamicGrid::first_slot(std::int64_t x, std::int64_t y, std::int64_t z) const noexcept {
  const auto key = static_cast<std::uint64_t>(x) * kGolden64 ^ static_cast<std::uint64_t>(y) * kMixY ^
                   static_cast<std::uint64_t>(z) * kMixZ;
  return (key * kGolden64) >> shift_;
}

std::size_t DynamicGrid::find_spare(const Cell& cell) const noexcept {
  const std::size_t mask = spare_.size() - 1;
  std::size_t at = first_slot(cell.x, cell.y, cell.z);
  while (spare_[at].leaf.listed != 0 &&
         (spare_[at].x != cell.x || spare_[at].y != cell.y || spare_[at].z != cell.z))
    at = (at + 1) & mask;  // terminates: half of the slots are free
  return at;
}

/// Moves later cells of the run up, so that look-ups do not end early.
void DynamicGrid::free_spare(std::size_t at) noexcept {
  const std::size_t mask = spare_.size() - 1;
  std::size_t free = at;
  for (std::size_t next = (at + 1) & mask; spare_[next].leaf.listed != 0; next = (next + 1) & mask) {
    const std::size_t wanted = first_slot(spare_[next].x, spare_[next].y, spare_[next].z);
    if (((next - wanted) & mask) < ((next - free) & mask)) continue;
    spare_[free] = spare_[next];
    free = next;
  }
  spare_[free] = {};
  --used_;
}

bool DynamicGrid::has_room(const Cell& cell) const noexcept {
  if (grid_.slot_of(cell) != UniformGrid::kNoSlot) return true;
  return is_near(cell) && (used_ < most_ || spare_[find_spare(cell)].leaf.listed != 0);
}

void DynamicGrid::leave_cell(std::uint32_t place, const Cell& cell) noexcept {
  const std::size_t slot = grid_.slot_of(cell);
  if (slot != UniformGrid::kNoSlot) {
    moved_.leave(states_[slot], place);
    return;
  }
  const std::size_t at = find_spare(cell);
  moved_.leave(spare_[at].leaf, place);
  if (spare_[at].leaf.listed == 0) free_spare(at);
}

void DynamicGrid::enter_cell(std::uint32_t place, const Cell& cell) noexcept {
  const std::size_t slot = grid_.slot_of(cell);
  if (slot != UniformGrid::kNoSlot) {
    moved_.enter(states_[slot], grid_.places_of(slot), place);
    return;
  }
  SpareCell& spare = spare_[find_spare(cell)];
  if (spare.leaf.listed == 0) {
    spare = {static_cast<std::int32_t>(cell.x),
             static_cast<std::int32_t>(cell.y),
             static_cast<std::int32_t>(cell.z),
             {}};
    ++used_;
  }
  moved_.enter(spare.leaf, {}, place);
  const Vec3 where(static_cast<double>(cell.x), static_cast<double>(cell.y), static_cast<double>(cell.z));
  box_.first = box_.first.cwiseMin(where);
  box_.last = box_.last.cwiseMax(where);
}

MoveStatus DynamicGrid::change_cell(std::uint32_t place, const Cell& from, const Cell& to) noexcept {
  if (!has_room(to)) return MoveStatus::kFull;
  leave_cell(place, from);
  enter_cell(place, to);
  return MoveStatus::kMoved;
}

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
