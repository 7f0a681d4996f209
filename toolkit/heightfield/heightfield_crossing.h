// The bilinear surface over a height field's posts.
//
// Plan coordinates are in posts: cell (column, row) spans [column, column + 1] x [row, row + 1], and s, t in
// [0, 1] locate a point inside it. Heights and distances are in mm.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>

#include <palpate/vec.h>
#include "toolkit/cloud/height_field.h"

namespace palpate::heightfield {

/// A point in plan coordinates: x and y in posts, z in mm over the field's origin.
struct PlanPoint {
  double x = 0.0, y = 0.0, z = 0.0;
};

/// A point of the surface by its cell.
struct CellPosition {
  std::int32_t column = 0, row = 0;
  double s = 0.0, t = 0.0;
};

/// z = a + b s + c t + d s t over one cell. NaN everywhere if a post of the cell is a hole.
struct BilinearPatch {
  double a = 0.0, b = 0.0, c = 0.0, d = 0.0;

  [[nodiscard]] double height(double s, double t) const noexcept { return a + b * s + t * (c + d * s); }
  [[nodiscard]] bool exists() const noexcept { return a + b + c + d == a + b + c + d; }
};

/// The data of a frame. Refers to a HeightField, which must outlive it.
struct HeightFieldView {
  const float* height = nullptr;
  const float* top = nullptr;
  std::int32_t columns = 0, rows = 0;
  std::int32_t block_columns = 0;
  double step_x = 1.0, step_y = 1.0;         ///< mm
  double inverse_x = 1.0, inverse_y = 1.0;   ///< 1/mm
  double x_sq = 1.0, y_sq = 1.0;             ///< step squared, mm^2
  double last_column = 0.0, last_row = 0.0;  ///< of posts: the field's end
  double high_mm = 0.0;

  HeightFieldView() = default;
  explicit HeightFieldView(const cloud::HeightField& field) noexcept
      : height(field.height_mm.data()),
        top(field.block_max_mm.data()),
        columns(static_cast<std::int32_t>(field.columns)),
        rows(static_cast<std::int32_t>(field.rows)),
        block_columns(static_cast<std::int32_t>(field.block_columns())),
        step_x(field.step_x_mm),
        step_y(field.step_y_mm),
        inverse_x(1.0 / field.step_x_mm),
        inverse_y(1.0 / field.step_y_mm),
        x_sq(step_x * step_x),
        y_sq(step_y * step_y),
        last_column(columns - 1),
        last_row(rows - 1),
        high_mm(static_cast<double>(field.high_mm)) {}

  [[nodiscard]] bool has_cell(std::int32_t column, std::int32_t row) const noexcept {
    return static_cast<std::uint32_t>(column) < static_cast<std::uint32_t>(columns - 1) &&
           static_cast<std::uint32_t>(row) < static_cast<std::uint32_t>(rows - 1);
  }
  /// For an existing cell.
  [[nodiscard]] BilinearPatch patch(std::int32_t column, std::int32_t row) const noexcept {
    const float* const low = height + static_cast<std::ptrdiff_t>(row) * columns + column;
    const float* const up = low + columns;
    const double a = static_cast<double>(low[0]), b = static_cast<double>(low[1]) - a;
    const double c = static_cast<double>(up[0]) - a;
    return {a, b, c, static_cast<double>(up[1]) - static_cast<double>(up[0]) - b};
  }
  /// For any cell, existing or not.
  [[nodiscard]] BilinearPatch patch_or_none(std::int32_t column, std::int32_t row) const noexcept {
    if (has_cell(column, row)) return patch(column, row);
    return {std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0, 0.0};
  }
  [[nodiscard]] PlanPoint plan(const Vec3& local_mm) const noexcept {
    return {local_mm.x() * inverse_x, local_mm.y() * inverse_y, local_mm.z()};
  }
  [[nodiscard]] Vec3 local(const PlanPoint& p) const noexcept { return {p.x * step_x, p.y * step_y, p.z}; }
  [[nodiscard]] PlanPoint point(const CellPosition& position) const noexcept {
    return {position.column + position.s, position.row + position.t,
            patch(position.column, position.row).height(position.s, position.t)};
  }
  [[nodiscard]] double distance_sq(const PlanPoint& a, const PlanPoint& b) const noexcept {
    const double x = a.x - b.x, y = a.y - b.y, z = a.z - b.z;
    return x_sq * (x * x) + y_sq * (y * y) + z * z;
  }
};

/// Half the squared distance from a point of a patch to the HIP: derivatives by s and t, mm^2.
struct DistanceDerivatives {
  double gs = 0.0, gt = 0.0;               ///< gradient
  double hss = 0.0, hst = 0.0, htt = 0.0;  ///< Hessian
  double zs = 0.0, zt = 0.0;               ///< of the patch, mm

  /// `hs`, `ht`: the HIP in cell coordinates.
  DistanceDerivatives(const HeightFieldView& sheet, const BilinearPatch& p, double s, double t, double hs,
                      double ht, double hz) noexcept
      : zs(p.b + p.d * t), zt(p.c + p.d * s) {
    const double r = (p.a + p.b * s) + zt * t - hz;
    gs = sheet.x_sq * (s - hs) + r * zs;
    gt = sheet.y_sq * (t - ht) + r * zt;
    hss = sheet.x_sq + zs * zs;
    htt = sheet.y_sq + zt * zt;
    hst = zs * zt + r * p.d;
  }
  [[nodiscard]] double determinant() const noexcept { return hss * htt - hst * hst; }
};

// Exact test of the HIP's segment against a bilinear surface from above, cell by cell.

/// Cells and blocks tested per frame, about 10 ns each. A segment above a block's top passes its 16 x 16
/// cells in one test.
inline constexpr int kMaxCrossingTests = 512;

/// Side of the tested path's end.
enum class SheetSide : std::uint8_t {
  kAbove,    ///< free, over the sheet if it exists there
  kUnder,    ///< below, having come through a border or hole: free until above again
  kNowhere,  ///< beside the field or over a hole
};

struct Crossing {
  bool hit = false;
  bool cut = false;                      ///< the bound was reached: tested up to `reached` only
  CellPosition position;                 ///< crossing point, if any
  PlanPoint reached;                     ///< end of the tested part
  SheetSide side = SheetSide::kNowhere;  ///< side of `reached`
  int edges = 0;                         ///< entries below the surface without crossing it
};

/// Tests a -> b for the first crossing from above to below. `side` is that of `a`; a HIP known to be above is
/// never lost to rounding. With `from_sheet`, `a` is the sheet's point at `*from_sheet` and the segment
/// leaves upwards. `tests_left` counts down. Allocates nothing.
Crossing find_crossing(const HeightFieldView& sheet, const PlanPoint& a, const PlanPoint& b, SheetSide side,
                       const CellPosition* from_sheet, int& tests_left) noexcept;

/// The side of a place without history: above, under or nowhere.
SheetSide side_of(const HeightFieldView& sheet, const PlanPoint& p) noexcept;

/// Moves of a descent: in-cell steps and cell crossings. At 5 m/s and 0.1 mm posts the HIP passes 50 cells a
/// frame; 256 moves suffice on the diagonal too.
inline constexpr int kMaxDescentMoves = 256;

/// Result of a descent.
struct Descent {
  bool arrived = false;  ///< at a local minimum; else the bound was reached
  bool at_rim = false;   ///< a border or hole edge holds the minimum; beyond it is nearer
};

/// Moves `position` to the local minimum of the distance to `h` over the sheet, never increasing it: in a
/// cell, a crease, on a post, or at the rim. `moves` counts down. The position's cell must exist. Allocates
/// nothing.
Descent descend(const HeightFieldView& sheet, CellPosition& position, const PlanPoint& h,
                int& moves) noexcept;

}  // namespace palpate::heightfield
