#include "toolkit/search/uniform_grid.h"

#include <algorithm>
#include <bit>

#include "toolkit/core/hash.h"
#include "toolkit/search/morton_order.h"

namespace palpate::search {
namespace {

/// Finer curve inside a cell: 2^3 cubes an edge, about one surface point each at five spacings a cell.
constexpr int kFinerBits = 3;

std::uint64_t packed(std::uint64_t x, std::uint64_t y, std::uint64_t z) noexcept {
  return x | y << kMortonBits | z << (2 * kMortonBits);
}

}  // namespace

std::size_t UniformGrid::slot_of(const Cell& cell) const noexcept {
  constexpr std::int64_t kCells = std::int64_t{1} << kMortonBits;
  const auto inside = [](std::int64_t c) {
    return static_cast<std::uint64_t>(c) < static_cast<std::uint64_t>(kCells);
  };
  if (!inside(cell.x) || !inside(cell.y) || !inside(cell.z)) return kNoSlot;
  const std::uint64_t key = packed(static_cast<std::uint64_t>(cell.x), static_cast<std::uint64_t>(cell.y),
                                   static_cast<std::uint64_t>(cell.z));
  const std::size_t mask = slots_.size() - 1;
  std::size_t at = (key * kGolden64) >> shift_;
  while (slots_[at].key != kNoKey) {  // terminates: half of the slots are free
    if (slots_[at].key == key) return at;
    at = (at + 1) & mask;
  }
  return kNoSlot;
}

IndexRange UniformGrid::find(const Cell& cell) const noexcept {
  const std::size_t slot = slot_of(cell);
  return slot == kNoSlot ? IndexRange{} : slots_[slot].places;
}

void UniformGrid::insert(std::uint64_t key, IndexRange places) noexcept {
  const std::size_t mask = slots_.size() - 1;
  std::size_t at = (key * kGolden64) >> shift_;
  while (slots_[at].key != kNoKey) at = (at + 1) & mask;
  slots_[at] = {key, places};
  max_points_ = std::max(max_points_, places.end - places.begin);
}

LeafStatistics UniformGrid::statistics() const noexcept {
  LeafStatistics found;
  found.leaves = occupied_;
  found.nodes = slots_.size();
  found.max_points = max_points_;
  std::size_t points = 0;
  for (const Slot& slot : slots_) points += slot.places.end - slot.places.begin;
  if (occupied_ > 0) found.mean_points = static_cast<double>(points) / static_cast<double>(occupied_);
  return found;
}

double UniformGrid::cell_for(const cloud::Cloud& cloud, double cell_mm, int threads) {
  return Lattice::over(local_box(cloud, threads), cell_mm / (1 << kFinerBits)).unit_mm * (1 << kFinerBits);
}

UniformGrid UniformGrid::build(const cloud::Cloud& cloud, double cell_mm, int threads) {
  UniformGrid grid;
  // Cells are 8 x 8 x 8 cubes of a finer lattice, so one sort serves both.
  Lattice fine = Lattice::over(local_box(cloud, threads), cell_mm / (1 << kFinerBits));
  MortonOrder sorted = sort_by_morton(cloud, fine, threads);
  grid.lattice_ = {fine.low_mm, fine.unit_mm * (1 << kFinerBits), fine.per_mm / (1 << kFinerBits)};
  grid.order_ = std::move(sorted.order);

  constexpr int kCellShift = 3 * kFinerBits;
  const std::size_t n = sorted.codes.size();
  std::size_t cells = 0;
  for (std::size_t i = 0; i < n; ++i)
    cells += i == 0 || (sorted.codes[i] >> kCellShift) != (sorted.codes[i - 1] >> kCellShift);
  grid.occupied_ = cells;
  const std::size_t slots = std::bit_ceil(std::max<std::size_t>(2 * cells, 2));
  grid.slots_.resize(slots);
  grid.shift_ = 64 - std::countr_zero(slots);
  std::size_t begin = 0;
  for (std::size_t i = 1; i <= n; ++i) {
    if (i < n && (sorted.codes[i] >> kCellShift) == (sorted.codes[begin] >> kCellShift)) continue;
    const auto [x, y, z] = coordinate_of_code(sorted.codes[begin] >> kCellShift);
    grid.last_cell_ = std::max<std::int64_t>(grid.last_cell_, std::max({x, y, z}));
    grid.insert(
        packed(static_cast<std::uint64_t>(x), static_cast<std::uint64_t>(y), static_cast<std::uint64_t>(z)),
        {static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(i)});
    begin = i;
  }
  return grid;
}

}  // namespace palpate::search
