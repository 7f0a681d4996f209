// The god object's way over a bilinear surface: downhill in distance from where it was, from cell to cell.
#pragma once

#include "toolkit/heightfield/heightfield_sheet.h"

namespace palpate::render {

/// Moves of one descent: an in-cell step or a crossing into the next cell. At 5 m/s and posts 0.1 mm apart
/// the HIP passes 50 cells a frame; 256 moves cross them also on the diagonal.
inline constexpr int kMaxSheetMoves = 256;

/// How a descent ended.
struct Descent {
  bool arrived = false;  ///< at a local minimum; else the bound was reached on the way
  bool at_rim = false;   ///< the minimum is held by the border or by a hole's edge: beyond it is nearer
};

/// Moves `foot` to the local minimum of the distance to `h` over the sheet, reached without ever going
/// farther away: inside a cell, in the crease between cells, on a post, or at the sheet's rim. `moves` counts
/// down. The foot must stand on a cell that exists. Allocates nothing.
Descent descend(const HeightSheet& sheet, Foot& foot, const PlanPoint& h, int& moves) noexcept;

}  // namespace palpate::render
