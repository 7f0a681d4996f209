// The sparse uniform grid of section 3.1.2.3. Memory follows occupied cells, not volume. The cells that a
// segment crosses are the broad phase of section 3.1.3.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/vec.h>
#include "toolkit/core/hardware.h"
#include "toolkit/search/morton_order.h"
#include "toolkit/search/partition.h"

namespace palpate::search {

/// Integer cell coordinates; cells outside the cloud's box are empty.
struct Cell {
  std::int64_t x = 0, y = 0, z = 0;
};

/// Cubic cells from the cloud's low corner. A cell's points are contiguous in order(), a Morton curve eight
/// times finer with ties by cloud index, so neighbours share cache lines. Immutable after build; thread-safe
/// to read. Look-ups allocate nothing.
class UniformGrid {
 public:
  /// O(n). `cell_mm` > 0 is doubled until the cloud spans under 2^21 cells (see cell_mm()).
  [[nodiscard]] static UniformGrid build(const cloud::Cloud& cloud, double cell_mm, int threads);
  [[nodiscard]] static UniformGrid build(const cloud::Cloud& cloud, const PartitionOptions& options,
                                         int threads) {
    return build(cloud, options.cell_mm, threads);
  }

  /// The cell_mm() that build() will choose. O(n).
  [[nodiscard]] static double cell_for(const cloud::Cloud& cloud, double cell_mm, int threads);

  [[nodiscard]] double cell_mm() const noexcept { return lattice_.unit_mm; }
  /// Cloud index per place.
  [[nodiscard]] std::span<const std::uint32_t> order() const noexcept { return order_; }
  /// Frees order(), which only preparation needs.
  void drop_order() noexcept { std::vector<std::uint32_t>().swap(order_); }
  [[nodiscard]] Cell cell_of(const Vec3& local_mm) const noexcept {
    return {lattice_.coordinate(local_mm.x(), 0), lattice_.coordinate(local_mm.y(), 1),
            lattice_.coordinate(local_mm.z(), 2)};
  }
  /// The places of a cell; empty if none.
  [[nodiscard]] IndexRange find(const Cell& cell) const noexcept;
  /// The hash slot of an occupied cell, and its places; kNoSlot if empty.
  static constexpr std::size_t kNoSlot = ~std::size_t{0};
  [[nodiscard]] std::size_t slot_of(const Cell& cell) const noexcept;
  [[nodiscard]] IndexRange places_of(std::size_t slot) const noexcept { return slots_[slot].places; }
  [[nodiscard]] std::size_t slots() const noexcept { return slots_.size(); }
  /// The largest occupied cell coordinate on any axis.
  [[nodiscard]] std::int64_t last_cell() const noexcept { return last_cell_; }
  [[nodiscard]] std::size_t occupied_cells() const noexcept { return occupied_; }
  [[nodiscard]] std::uint32_t max_points_per_cell() const noexcept { return max_points_; }
  [[nodiscard]] const Lattice& lattice() const noexcept { return lattice_; }
  [[nodiscard]] LeafStatistics statistics() const noexcept;
  [[nodiscard]] std::size_t bytes() const noexcept {
    return slots_.capacity() * sizeof(Slot) + order_.capacity() * sizeof(std::uint32_t);
  }

 private:
  struct Slot {
    std::uint64_t key = kNoKey;
    IndexRange places;
  };
  static constexpr std::uint64_t kNoKey = ~std::uint64_t{0};
  void insert(std::uint64_t key, IndexRange places) noexcept;

  Lattice lattice_;
  std::vector<std::uint32_t> order_;
  LargePageVector<Slot> slots_;  ///< open addressing, linear probing, at most half full
  int shift_ = 0;
  std::size_t occupied_ = 0;
  std::int64_t last_cell_ = 0;
  std::uint32_t max_points_ = 0;
};

/// Tolerance on a position along the segment, relative to the coordinates: a nearer cell border counts as
/// crossed. Coordinates below 2^21 have rounding below 2^-51 of that, far less than this.
inline constexpr double kCellSlack = 1e-7;

/// A box of cells, both ends included.
struct CellRange {
  Vec3 first = Vec3::Zero(), last = Vec3::Zero();  ///< whole numbers
};

/// Calls visit(cell) for every cell of the box that the segment, widened by `reach_mm` per axis, touches (a
/// few more at corners), in order along the longest axis. Stops, and returns false, when visit returns false.
/// Clips the segment first: at most (n + 2 r) (2 r + 2)^2 cells for a segment spanning n cells and a reach of
/// r cells.
template <class Visit>
bool visit_cells(const Lattice& lattice, const CellRange& box, const Vec3& a_mm, const Vec3& b_mm,
                 const Vec3& reach_mm, Visit&& visit) {
  // In cell units, where the lattice starts at 0.
  const Vec3 a = (a_mm - lattice.low_mm) * lattice.per_mm;
  const Vec3 b = (b_mm - lattice.low_mm) * lattice.per_mm;
  const Vec3 reach = reach_mm * lattice.per_mm + Vec3::Constant(kCellSlack);
  const Vec3 low = a.cwiseMin(b) - reach, high = a.cwiseMax(b) + reach;
  const Vec3 end = box.last + Vec3::Ones();
  if ((high.array() < box.first.array()).any() || (low.array() > end.array()).any()) return true;

  int axis = 0;
  const Vec3 d = b - a;
  d.cwiseAbs().maxCoeff(&axis);
  const auto floor_in = [&box](double x, int of) {
    return static_cast<std::int64_t>(std::clamp(std::floor(x), box.first[of], box.last[of]));
  };
  const std::int64_t first_slab = floor_in(low[axis], axis), last_slab = floor_in(high[axis], axis);
  const bool forward = d[axis] >= 0.0;
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  for (std::int64_t i = 0; i <= last_slab - first_slab; ++i) {
    const std::int64_t slab = forward ? first_slab + i : last_slab - i;
    // The part of the segment whose widened box meets this slab.
    double t0 = 0.0, t1 = 1.0;
    if (d[axis] != 0.0) {
      const double s = (static_cast<double>(slab) - reach[axis] - a[axis]) / d[axis];
      const double e = (static_cast<double>(slab + 1) + reach[axis] - a[axis]) / d[axis];
      t0 = std::clamp(std::min(s, e), 0.0, 1.0);
      t1 = std::clamp(std::max(s, e), 0.0, 1.0);
    }
    const double u0 = a[u] + t0 * d[u], u1 = a[u] + t1 * d[u], v0 = a[v] + t0 * d[v], v1 = a[v] + t1 * d[v];
    const double u_low = std::min(u0, u1) - reach[u], u_high = std::max(u0, u1) + reach[u];
    const double v_low = std::min(v0, v1) - reach[v], v_high = std::max(v0, v1) + reach[v];
    if (u_high < box.first[u] || v_high < box.first[v] || u_low > end[u] || v_low > end[v]) continue;
    const std::int64_t ub = floor_in(u_low, u), ue = floor_in(u_high, u);
    const std::int64_t vb = floor_in(v_low, v), ve = floor_in(v_high, v);
    for (std::int64_t iv = vb; iv <= ve; ++iv)
      for (std::int64_t iu = ub; iu <= ue; ++iu) {
        std::int64_t at[3];
        at[axis] = slab;
        at[u] = iu;
        at[v] = iv;
        if (!visit(Cell{at[0], at[1], at[2]})) return false;
      }
  }
  return true;
}

/// The same for the grid's own box.
template <class Visit>
bool visit_cells(const UniformGrid& grid, const Vec3& a_mm, const Vec3& b_mm, const Vec3& reach_mm,
                 Visit&& visit) {
  const CellRange box{Vec3::Zero(), Vec3::Constant(static_cast<double>(grid.last_cell()))};
  return visit_cells(grid.lattice(), box, a_mm, b_mm, reach_mm, visit);
}

/// The ranges of visit_cells' cells, including empty ones: each is a look-up.
template <class Visit>
bool visit_segment_ranges(const UniformGrid& grid, const Vec3& a_mm, const Vec3& b_mm, const Vec3& reach_mm,
                          Visit&& visit) {
  if (!is_finite(a_mm) || !is_finite(b_mm)) return true;
  return visit_cells(grid, a_mm, b_mm, reach_mm, [&](const Cell& cell) { return visit(grid.find(cell)); });
}

template <class Visit>
bool visit_point_range(const UniformGrid& grid, const Vec3& point_mm, Visit&& visit) {
  return visit(grid.find(grid.cell_of(point_mm)));
}

static_assert(Partition<UniformGrid>);

}  // namespace palpate::search
