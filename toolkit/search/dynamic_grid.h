// The uniform grid under deformation (section 3.1.2.3), including points that leave the first box.
#pragma once

#include <cstdint>
#include <span>

#include "toolkit/search/grid_traversal.h"
#include "toolkit/search/moved_points.h"

namespace palpate::search {

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

}  // namespace palpate::search
