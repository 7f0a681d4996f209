// Where the HIP's segment goes through a bilinear surface from above: exact in every cell, cell after cell.
#pragma once

#include <limits>

#include "toolkit/heightfield/heightfield_sheet.h"

namespace palpate::render {

/// Cells and blocks of cells one frame may look into, at some 10 ns each. A segment above a block's top
/// passes its 16 x 16 cells in one look.
inline constexpr int kMaxSegmentLooks = 512;

/// Where the end of the tested path is.
enum class SheetSide : std::uint8_t {
  kAbove,    ///< free, and over the sheet where there is one
  kUnder,    ///< under it, having come through the border or a hole: free, and still so until above
  kNowhere,  ///< beside the field or over a hole
};

struct Crossing {
  bool hit = false;
  bool cut = false;                      ///< the bound was reached: tested up to `reached` only
  Foot foot;                             ///< where it went through, if it did
  PlanPoint reached;                     ///< up to where the segment has been tested
  SheetSide side = SheetSide::kNowhere;  ///< of `reached`
  int edges = 0;  ///< times the segment came under the surface without going through it
};

/// Tests a -> b for the first place where it goes from above the sheet to below. `side` is that of `a`; a
/// HIP known to be above is never lost to rounding. With `from_sheet`, `a` is a point of the sheet at
/// `*from_sheet` and the segment leaves it upwards. `looks` counts down. Allocates nothing.
Crossing find_crossing(const HeightSheet& sheet, const PlanPoint& a, const PlanPoint& b, SheetSide side,
                       const Foot* from_sheet, int& looks) noexcept;

/// The side of a place that no path leads to: above, under or nowhere.
SheetSide side_of(const HeightSheet& sheet, const PlanPoint& p) noexcept;

}  // namespace palpate::render
