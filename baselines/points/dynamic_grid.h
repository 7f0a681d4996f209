// A uniform grid of points that move.
// Section 3.1.2.3, including points that leave the first box.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/vec.h>
#include "toolkit/core/hardware.h"
#include "toolkit/search/partition.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::baselines {

/// A stored point in double, exactly. In a separate translation unit on purpose: if both conversions double
/// -> float -> double are in one function, GCC 12 at -O2 vectorises them away (for three components), and a
/// point would be searched a rounding beside its stored place.
[[nodiscard]] Vec3 widened(const Vec3f& stored) noexcept;

/// The result of moving a point.
enum class MoveStatus : std::uint8_t {
  kStays,  ///< in its cell: nothing changed
  kMoved,
  kFull,  ///< no spare room, or too far: nothing changed, and the point must stay
};

/// A cell's state while points move, besides its range.
struct CellState {
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  std::uint32_t head = kNone;  ///< first place of the list
  std::uint32_t listed = 0;    ///< length of the list
  std::uint32_t away = 0;      ///< places of the own range that are listed elsewhere
};

/// A doubly linked list per cell, stored as two numbers a place: any place can be removed, and no pool runs
/// out. 8 1/8 bytes a point. O(1) except visit.
class MovedPoints {
 public:
  explicit MovedPoints(std::size_t places = 0) : links_(places), away_((places + 63) / 64, 0) {}

  [[nodiscard]] bool is_away(std::uint32_t place) const noexcept {
    return (away_[place / 64] >> (place % 64) & 1u) != 0;
  }

  /// Adds a place to a cell with range `home`: back into the range, or to the list.
  void enter(CellState& cell, search::IndexRange home, std::uint32_t place) noexcept {
    if (home.begin <= place && place < home.end) {
      away_[place / 64] &= ~(std::uint64_t{1} << place % 64);
      --cell.away;
      return;
    }
    links_[place] = {CellState::kNone, cell.head};
    if (cell.head != CellState::kNone) links_[cell.head].before = place;
    cell.head = place;
    ++cell.listed;
  }
  /// Removes a place from its cell; it must enter another.
  void leave(CellState& cell, std::uint32_t place) noexcept {
    if (!is_away(place)) {
      away_[place / 64] |= std::uint64_t{1} << place % 64;
      ++cell.away;
      return;
    }
    const Link link = links_[place];
    if (link.before != CellState::kNone)
      links_[link.before].after = link.after;
    else
      cell.head = link.after;
    if (link.after != CellState::kNone) links_[link.after].before = link.before;
    --cell.listed;
  }

  /// Calls visit(range) for all places of a cell: its remaining range in runs, then the list.
  template <class Visit>
  bool visit(const CellState& cell, search::IndexRange home, Visit&& visit) const {
    if (cell.away == 0) {
      if (!home.empty() && !visit(home)) return false;
    } else {
      for (std::uint32_t at = home.begin; at < home.end;) {
        const std::uint32_t run = run_end(at, home.end);
        if (run > at && !visit(search::IndexRange{at, run})) return false;
        at = run + 1;
      }
    }
    for (std::uint32_t place = cell.head; place != CellState::kNone; place = links_[place].after)
      if (!visit(search::IndexRange{place, place + 1})) return false;
    return true;
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return links_.capacity() * sizeof(Link) + away_.capacity() * sizeof(std::uint64_t);
  }

 private:
  struct Link {
    std::uint32_t before = CellState::kNone, after = CellState::kNone;
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

/// A uniform grid with moving points, which their owner stores as floats. Cells empty at build come from a
/// table of spare cells and return to it; they may lie within 2^31 cells of the first box. Places keep their
/// numbers; a place that left its cell's range is a range of its own, so each still comes at most once.
/// Nothing may read it during a move. Extra memory: 8 1/8 bytes a point, 12 a slot, 32 a spare cell.
class DynamicGrid {
 public:
  /// Least number of spare cells, so that small clouds can move too.
  static constexpr std::size_t kMinSpare = 64;

  [[nodiscard]] static DynamicGrid build(const cloud::Cloud& cloud, const search::PartitionOptions& options,
                                         int threads);

  [[nodiscard]] std::span<const std::uint32_t> order() const noexcept { return grid_.order(); }
  void drop_order() noexcept { grid_.drop_order(); }
  [[nodiscard]] double cell_mm() const noexcept { return grid_.cell_mm(); }
  [[nodiscard]] std::size_t bytes() const noexcept;
  [[nodiscard]] search::LeafStatistics statistics() const noexcept;
  /// Number of unused spare cells.
  [[nodiscard]] std::size_t spare_left() const noexcept { return most_ - used_; }

  /// After any result but kFull the owner stores `to_mm`. kFull: no spare cells, or the point is too far away
  /// or not finite. Looks up at most two cells; allocates nothing.
  [[nodiscard]] MoveStatus move(std::uint32_t place, const Vec3f& from_mm, const Vec3f& to_mm) noexcept {
    const search::Cell from = grid_.cell_of(widened(from_mm)), to = grid_.cell_of(widened(to_mm));
    if (from.x == to.x && from.y == to.y && from.z == to.z) return MoveStatus::kStays;
    return change_cell(place, from, to);
  }

  /// The box of all cells ever occupied.
  [[nodiscard]] const search::CellRange& box() const noexcept { return box_; }
  [[nodiscard]] const search::Lattice& lattice() const noexcept { return grid_.lattice(); }
  [[nodiscard]] search::Cell cell_of(const Vec3& local_mm) const noexcept { return grid_.cell_of(local_mm); }

  template <class Visit>
  bool visit_cell(const search::Cell& cell, Visit&& visit) const {
    const std::size_t slot = grid_.slot_of(cell);
    if (slot != search::UniformGrid::kNoSlot)
      return moved_.visit(states_[slot], grid_.places_of(slot), visit);
    if (used_ == 0) return true;
    const SpareCell& spare = spare_[find_spare(cell)];
    return spare.state.listed == 0 || moved_.visit(spare.state, {}, visit);
  }

 private:
  struct SpareCell {
    std::int32_t x = 0, y = 0, z = 0;
    CellState state;  ///< listed == 0: a free slot
  };

  [[nodiscard]] MoveStatus change_cell(std::uint32_t place, const search::Cell& from,
                                       const search::Cell& to) noexcept;
  [[nodiscard]] bool has_room(const search::Cell& cell) const noexcept;
  void leave_cell(std::uint32_t place, const search::Cell& cell) noexcept;
  void enter_cell(std::uint32_t place, const search::Cell& cell) noexcept;
  /// The slot of a used spare cell, or the free one where it would go.
  [[nodiscard]] std::size_t find_spare(const search::Cell& cell) const noexcept;
  [[nodiscard]] std::size_t first_slot(std::int64_t x, std::int64_t y, std::int64_t z) const noexcept;
  void free_spare(std::size_t at) noexcept;

  search::UniformGrid grid_;
  MovedPoints moved_;
  LargePageVector<CellState> states_;  ///< by slot of the grid
  LargePageVector<SpareCell> spare_;   ///< open addressing, linear probing, at most half full
  std::size_t most_ = 0, used_ = 0;
  int shift_ = 0;
  search::CellRange box_;
};

template <class Visit>
bool visit_segment_ranges(const DynamicGrid& grid, const Vec3& a_mm, const Vec3& b_mm, const Vec3& reach_mm,
                          Visit&& visit) {
  if (!is_finite(a_mm) || !is_finite(b_mm)) return true;
  return search::visit_cells(grid.lattice(), grid.box(), a_mm, b_mm, reach_mm,
                             [&](const search::Cell& cell) { return grid.visit_cell(cell, visit); });
}

template <class Visit>
bool visit_point_range(const DynamicGrid& grid, const Vec3& point_mm, Visit&& visit) {
  return grid.visit_cell(grid.cell_of(point_mm), visit);
}

static_assert(search::Partition<DynamicGrid>);

}  // namespace palpate::baselines
