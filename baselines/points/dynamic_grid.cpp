#include "baselines/points/dynamic_grid.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "toolkit/core/hash.h"

namespace palpate::baselines {

Vec3 widened(const Vec3f& stored) noexcept {
  return stored.cast<double>();
}

namespace {

/// Largest cell distance from the first box; coordinates are stored in 32 bits.
constexpr std::int64_t kFarthestGridCell = (std::int64_t{1} << 31) - 1;

bool in_grid_reach(const search::Cell& cell) noexcept {
  const auto near = [](std::int64_t c) { return -kFarthestGridCell <= c && c <= kFarthestGridCell; };
  return near(cell.x) && near(cell.y) && near(cell.z);
}

}  // namespace

DynamicGrid DynamicGrid::build(const cloud::Cloud& cloud, const search::PartitionOptions& options,
                               int threads) {
  DynamicGrid grid;
  grid.grid_ = search::UniformGrid::build(cloud, options.cell_mm, threads);
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
  return grid_.bytes() + moved_.bytes() + states_.capacity() * sizeof(CellState) +
         spare_.capacity() * sizeof(SpareCell);
}

search::LeafStatistics DynamicGrid::statistics() const noexcept {
  search::LeafStatistics found;
  found.nodes = states_.size() + spare_.size();
  std::size_t points = 0;
  const auto count = [&](std::uint32_t here) {
    found.leaves += here > 0;
    points += here;
    found.max_points = std::max(found.max_points, here);
  };
  for (std::size_t slot = 0; slot < states_.size(); ++slot) {
    const search::IndexRange home = grid_.places_of(slot);
    count(home.end - home.begin - states_[slot].away + states_[slot].listed);
  }
  for (const SpareCell& cell : spare_) count(cell.state.listed);
  if (found.leaves > 0) found.mean_points = static_cast<double>(points) / static_cast<double>(found.leaves);
  return found;
}

std::size_t DynamicGrid::first_slot(std::int64_t x, std::int64_t y, std::int64_t z) const noexcept {
  const auto key = static_cast<std::uint64_t>(x) * kGolden64 ^ static_cast<std::uint64_t>(y) * kMixFirst64 ^
                   static_cast<std::uint64_t>(z) * kMixSecond64;
  return (key * kGolden64) >> shift_;
}

std::size_t DynamicGrid::find_spare(const search::Cell& cell) const noexcept {
  const std::size_t mask = spare_.size() - 1;
  std::size_t at = first_slot(cell.x, cell.y, cell.z);
  while (spare_[at].state.listed != 0 &&
         (spare_[at].x != cell.x || spare_[at].y != cell.y || spare_[at].z != cell.z))
    at = (at + 1) & mask;  // terminates: half of the slots are free
  return at;
}

/// Moves later cells of the run up, so that look-ups do not end early.
void DynamicGrid::free_spare(std::size_t at) noexcept {
  const std::size_t mask = spare_.size() - 1;
  std::size_t free = at;
  for (std::size_t next = (at + 1) & mask; spare_[next].state.listed != 0; next = (next + 1) & mask) {
    const std::size_t wanted = first_slot(spare_[next].x, spare_[next].y, spare_[next].z);
    if (((next - wanted) & mask) < ((next - free) & mask)) continue;
    spare_[free] = spare_[next];
    free = next;
  }
  spare_[free] = {};
  --used_;
}

bool DynamicGrid::has_room(const search::Cell& cell) const noexcept {
  if (grid_.slot_of(cell) != search::UniformGrid::kNoSlot) return true;
  return in_grid_reach(cell) && (used_ < most_ || spare_[find_spare(cell)].state.listed != 0);
}

void DynamicGrid::leave_cell(std::uint32_t place, const search::Cell& cell) noexcept {
  const std::size_t slot = grid_.slot_of(cell);
  if (slot != search::UniformGrid::kNoSlot) {
    moved_.leave(states_[slot], place);
    return;
  }
  const std::size_t at = find_spare(cell);
  moved_.leave(spare_[at].state, place);
  if (spare_[at].state.listed == 0) free_spare(at);
}

void DynamicGrid::enter_cell(std::uint32_t place, const search::Cell& cell) noexcept {
  const std::size_t slot = grid_.slot_of(cell);
  if (slot != search::UniformGrid::kNoSlot) {
    moved_.enter(states_[slot], grid_.places_of(slot), place);
    return;
  }
  SpareCell& spare = spare_[find_spare(cell)];
  if (spare.state.listed == 0) {
    spare = {static_cast<std::int32_t>(cell.x),
             static_cast<std::int32_t>(cell.y),
             static_cast<std::int32_t>(cell.z),
             {}};
    ++used_;
  }
  moved_.enter(spare.state, {}, place);
  const Vec3 where(static_cast<double>(cell.x), static_cast<double>(cell.y), static_cast<double>(cell.z));
  box_.first = box_.first.cwiseMin(where);
  box_.last = box_.last.cwiseMax(where);
}

MoveStatus DynamicGrid::change_cell(std::uint32_t place, const search::Cell& from,
                                    const search::Cell& to) noexcept {
  if (!has_room(to)) return MoveStatus::kFull;
  leave_cell(place, from);
  enter_cell(place, to);
  return MoveStatus::kMoved;
}

}  // namespace palpate::baselines
