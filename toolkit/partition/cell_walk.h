// The cells a segment crosses, none missed: the broad phase of section 3.1.3.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "toolkit/core/vec.h"
#include "toolkit/partition/uniform_grid.h"

namespace palpate::partition {

/// Rounding of a position along the segment, relative to the coordinates' size: a cell border closer than
/// this counts as crossed. Cell coordinates are below 2^21 and their rounding below 2^-51 of that, far below
/// this share of a cell.
inline constexpr double kCellSlack = 1e-7;

/// Calls visit(cell) for every cell of the grid that the segment, widened by `reach_mm` on each axis,
/// touches; a few more at corners. Cells come in order along the segment's longest axis. visit returns false
/// to stop. Returns false when stopped. The segment is clipped to the cloud's box first, so the work is
/// bounded by the grid's dimensions: at most (n + 2 r) (2 r + 2)^2 cells for a segment spanning n cells and a
/// reach of r cells.
template <class Visit>
bool visit_cells(const UniformGrid& grid, const Vec3& a_mm, const Vec3& b_mm, const Vec3& reach_mm,
                 Visit&& visit) {
  const Lattice& lattice = grid.lattice();
  // In cell units, where the lattice starts at 0.
  const Vec3 a = (a_mm - lattice.low_mm) * lattice.per_mm;
  const Vec3 b = (b_mm - lattice.low_mm) * lattice.per_mm;
  const Vec3 reach = reach_mm * lattice.per_mm + Vec3::Constant(kCellSlack);
  const double last = static_cast<double>(grid.last_cell());
  const Vec3 low = a.cwiseMin(b) - reach, high = a.cwiseMax(b) + reach;
  if ((high.array() < 0.0).any() || (low.array() > last + 1.0).any()) return true;

  int axis = 0;
  const Vec3 d = b - a;
  d.cwiseAbs().maxCoeff(&axis);
  const auto floor_in = [last](double x) {
    return static_cast<std::int64_t>(std::clamp(std::floor(x), 0.0, last));
  };
  const std::int64_t first_slab = floor_in(low[axis]), last_slab = floor_in(high[axis]);
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
    if (std::max(u0, u1) + reach[u] < 0.0 || std::max(v0, v1) + reach[v] < 0.0) continue;
    if (std::min(u0, u1) - reach[u] > last + 1.0 || std::min(v0, v1) - reach[v] > last + 1.0) continue;
    const std::int64_t ub = floor_in(std::min(u0, u1) - reach[u]), ue = floor_in(std::max(u0, u1) + reach[u]);
    const std::int64_t vb = floor_in(std::min(v0, v1) - reach[v]), ve = floor_in(std::max(v0, v1) + reach[v]);
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

/// The ranges of visit_cells' cells, empty ones too: each is a look-up.
template <class Visit>
bool visit_ranges(const UniformGrid& grid, const Vec3& a_mm, const Vec3& b_mm, const Vec3& reach_mm,
                  Visit&& visit) {
  if (!is_finite(a_mm) || !is_finite(b_mm)) return true;
  return visit_cells(grid, a_mm, b_mm, reach_mm, [&](const Cell& cell) { return visit(grid.find(cell)); });
}

template <class Visit>
bool visit_at(const UniformGrid& grid, const Vec3& point_mm, Visit&& visit) {
  return visit(grid.find(grid.cell_of(point_mm)));
}

static_assert(Partition<UniformGrid>);

}  // namespace palpate::partition
