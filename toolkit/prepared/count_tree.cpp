#include "toolkit/prepared/count_tree.h"

#include <algorithm>
#include <bit>
#include <numeric>

namespace palpate::prepared {

CountTree::CountTree(std::uint64_t expected_points) {
  Grid root;
  root.bits = std::clamp(static_cast<int>(std::bit_width(expected_points)), kLeastRootBits, kMostRootBits);
  root_shift_ = kCodeBits - root.bits;
  root.counts.resize(std::size_t{1} << root.bits);
  grids_.push_back(std::move(root));
}

CountTree::Grid CountTree::make_grid(const CellKey& key, int depth) {
  Grid grid;
  grid.key = key;
  grid.depth = depth;
  // A grid ends where the key's first word does, so that its bits are of one word.
  grid.bits = std::min(kDivideBits, (depth < kCodeBits ? kCodeBits : kKeyBits) - depth);
  grid.counts.resize(std::size_t{1} << grid.bits);
  return grid;
}

CellKey CountTree::key_below(const Grid& grid, std::uint32_t slot) noexcept {
  CellKey key = grid.key;
  if (grid.depth < kCodeBits)
    key.high |= std::uint64_t{slot} << (kCodeBits - grid.depth - grid.bits);
  else
    key.low |= std::uint64_t{slot} << (kKeyBits - grid.depth - grid.bits);
  return key;
}

CountTree::Place CountTree::find_deep(const LatticePoint& p) const noexcept {
  const CellKey key = key_of(p);
  Place at;
  for (;;) {
    const Grid& grid = grids_[at.grid];
    const int end = grid.depth + grid.bits;
    const std::uint64_t bits = end <= kCodeBits ? key.high >> (kCodeBits - end) : key.low >> (kKeyBits - end);
    at.slot = static_cast<std::uint32_t>(bits & ((std::uint64_t{1} << grid.bits) - 1));
    const std::uint32_t child = grid.children.empty() ? 0 : grid.children[at.slot];
    if (child == 0) return at;
    at.grid = child;
  }
}

bool CountTree::divide_crowded(std::uint64_t most) {
  const auto grids = static_cast<std::uint32_t>(grids_.size());
  for (std::uint32_t g = first_uncounted_; g < grids; ++g) {
    const int end = grids_[g].depth + grids_[g].bits;
    if (end == kKeyBits) continue;
    for (std::uint32_t slot = 0; slot < grids_[g].counts.size(); ++slot) {
      if (grids_[g].counts[slot] <= most) continue;
      grids_[g].children.resize(grids_[g].counts.size(), 0);
      grids_[g].children[slot] = static_cast<std::uint32_t>(grids_.size());
      Grid child = make_grid(key_below(grids_[g], slot), end);
      grids_.push_back(std::move(child));
    }
  }
  first_uncounted_ = grids;
  return grids_.size() > grids;
}

bool CountTree::emit_nodes(std::uint32_t g, const std::vector<std::uint64_t>& before, std::uint32_t slot,
                           int bits) {
  Grid& grid = grids_[g];
  const std::uint32_t past = slot + (1u << bits);
  const std::uint64_t points = before[past] - before[slot];
  if (points == 0) return true;
  if (points > kMostCellPoints && bits > 0)
    return emit_nodes(g, before, slot, bits - 1) &&
           emit_nodes(g, before, slot + (1u << (bits - 1)), bits - 1);
  const std::uint32_t child = bits == 0 && !grid.children.empty() ? grid.children[slot] : 0;
  if (child != 0) return emit_grid(child, points);
  std::fill(grid.regions.begin() + slot, grid.regions.begin() + past,
            static_cast<std::uint32_t>(nodes_.size()));
  nodes_.push_back({key_below(grid, slot), grid.depth + grid.bits - bits, points});
  return true;
}

bool CountTree::emit_grid(std::uint32_t g, std::uint64_t expected) {
  grids_[g].regions.assign(grids_[g].counts.size(), kNone);
  std::vector<std::uint64_t> before(grids_[g].counts.size() + 1, 0);
  std::partial_sum(grids_[g].counts.begin(), grids_[g].counts.end(), before.begin() + 1);
  return before.back() == expected && emit_nodes(g, before, 0, grids_[g].bits);
}

bool CountTree::make_regions(std::uint64_t most) {
  nodes_.clear();
  regions_.clear();
  const std::vector<std::uint64_t>& root = grids_.front().counts;
  if (!emit_grid(0, std::accumulate(root.begin(), root.end(), std::uint64_t{0}))) return false;
  std::vector<std::uint32_t> region_of(nodes_.size());
  for (std::uint32_t i = 0; i < nodes_.size(); ++i) {
    if (regions_.empty() || regions_.back().points + nodes_[i].points > most) {
      const std::uint64_t first = regions_.empty() ? 0 : regions_.back().first + regions_.back().points;
      regions_.push_back({first, 0, i, i});
    }
    regions_.back().points += nodes_[i].points;
    regions_.back().past_node = i + 1;
    region_of[i] = static_cast<std::uint32_t>(regions_.size() - 1);
  }
  for (Grid& grid : grids_)
    for (std::uint32_t& region : grid.regions)
      if (region != kNone) region = region_of[region];
  return true;
}

}  // namespace palpate::prepared
