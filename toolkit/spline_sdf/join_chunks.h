// Joins the parts of a surface: which pieces go on over their seams, which side of each is outside, and which
// are closed, by what the bricks that two parts made have in common.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/spline_sdf/surface_chunk.h"

namespace palpate::render {

/// Of one chunk's pieces.
struct JoinedPiece {
  bool flipped = false;  ///< its distances change their sign
  PieceClass felt;

  void put(Brick& brick) const noexcept;
};

struct JoinedChunks {
  std::vector<std::vector<JoinedPiece>> pieces;  ///< by chunk and piece
  /// Area on seams where two parts contradict what was decided, as a share of all on seams.
  double contradicted = 0.0;
};

/// Puts the closed pieces and the number of levels in `grid`. `chunks`: by first_code; their bricks are not
/// read. Groups are joined by the sum of the agreement of their bricks, best supported first, as faces are
/// within a part. What is
/// not joined to a group that visibility has oriented is turned as looks_down() says. O(bricks log bricks).
[[nodiscard]] JoinedChunks join_chunks(const std::vector<SurfaceChunk>& chunks, BrickGrid& grid,
                                       bool both_sides, int threads);

}  // namespace palpate::render
