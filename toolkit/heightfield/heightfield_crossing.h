// Exact test of the HIP's segment against a bilinear surface from above, cell by cell.
#pragma once

#include <limits>

#include "toolkit/heightfield/heightfield_view.h"

namespace palpate::render {

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
  CellPosition foot;                     ///< crossing point, if any
  PlanPoint reached;                     ///< end of the tested part
  SheetSide side = SheetSide::kNowhere;  ///< side of `reached`
  int edges = 0;                         ///< entries below the surface without crossing it
};

/// Tests a -> b for the first crossing from above to below. `side` is that of `a`; a HIP known to be above is
/// never lost to rounding. With `from_sheet`, `a` is the sheet's point at `*from_sheet` and the segment
/// leaves upwards. `looks` counts down. Allocates nothing.
Crossing find_crossing(const HeightFieldView& sheet, const PlanPoint& a, const PlanPoint& b, SheetSide side,
                       const CellPosition* from_sheet, int& looks) noexcept;

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

/// Moves `foot` to the local minimum of the distance to `h` over the sheet, never increasing it: in a cell, a
/// crease, on a post, or at the rim. `moves` counts down. The foot's cell must exist. Allocates nothing.
Descent descend(const HeightFieldView& sheet, CellPosition& foot, const PlanPoint& h, int& moves) noexcept;

}  // namespace palpate::render
