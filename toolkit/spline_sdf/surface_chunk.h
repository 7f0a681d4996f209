// A part of a surface larger than memory: the bricks of one region, made from the points in and around it,
// the same in every division into regions but for their side, which is decided when all parts are joined.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/result.h>
#include "toolkit/spline_sdf/build_bricks.h"
#include "toolkit/spline_sdf/morton_points.h"
#include "toolkit/spline_sdf/spline_sdf_model.h"
#include "toolkit/spline_sdf/surface_writer.h"

namespace palpate::spline_sdf {

/// Frame that all parts share.
struct SurfaceFrame {
  PointFrame points;
  SplineSdfDecision measured;
  int coarser = 0;  ///< BrickGrid::coarser
  SplineSdfOptions build;
  std::shared_ptr<const MortonPoints> far;     ///< a sample of all points, for rays
  std::shared_ptr<const cloud::Cloud> sample;  ///< for distances
  [[nodiscard]] BrickGrid lattice() const { return brick_lattice(points.box_mm, measured.voxel_mm, coarser); }
  /// Distance around a region within which points inform its bricks, mm.
  [[nodiscard]] double margin_mm() const noexcept;
};

/// A brick by what joins it to others.
struct ChunkBrick {
  std::uint64_t code = 0;
  int level = 0;
  BrickSummary summary;  ///< its piece: of the chunk
};

struct SurfaceChunk {
  std::uint64_t first_code = 0;       ///< least code of the region, at level 0
  std::vector<ChunkBrick> own;        ///< in the region, level after level by code
  std::vector<ChunkBrick> rim;        ///< those of `own` beside other regions
  std::vector<ChunkBrick> seam;       ///< of other regions beside it, as made here
  std::vector<std::uint32_t> groups;  ///< OrientedPieces::group by piece; the others from 0
  SampleDistances distances;          ///< of the sample's points in the region
  std::uint64_t patches = 0;          ///< with their middle in the region
  std::vector<Brick> bricks;          ///< parallel to `own`
};

/// `points`: all within margin_mm() of the region. Independent of the number of threads. O(points).
[[nodiscard]] SurfaceChunk build_surface_chunk(cloud::Cloud points, const BrickRegion& region,
                                               const SurfaceFrame& frame, int threads);

// Joining the parts: which pieces go on over their seams, which side of each is outside, and which are
// closed, by what the bricks that two parts made have in common.

/// Of one chunk's pieces.
struct JoinedPiece {
  bool flipped = false;  ///< its distances change their sign
  PieceClass felt;

  void put(Brick& brick) const noexcept;
};

struct JoinedChunks {
  std::vector<std::vector<JoinedPiece>> pieces;  ///< by chunk and piece
  /// Area on seams where two parts contradict what was decided, as a share of all on seams: there a god
  /// object is lost.
  double contradicted = 0.0;
};

/// Numbers of a chunk's own bricks, by level.
using LevelCounts = std::array<std::uint32_t, BrickGrid::kMaxLevels>;
[[nodiscard]] LevelCounts level_counts(const SurfaceChunk& chunk);

/// Chunks whose own bricks are on disk: in memory are their rims, seams, groups and sums.
class StoredChunks {
 public:
  virtual ~StoredChunks() = default;
  [[nodiscard]] virtual const std::vector<SurfaceChunk>& chunks() const = 0;  ///< by first_code
  [[nodiscard]] virtual const LevelCounts& counts(std::size_t chunk) const = 0;
  /// Own bricks `first` to `first + count` of a chunk, into `out`.
  [[nodiscard]] virtual Status read_own(std::size_t chunk, std::size_t first, std::size_t count,
                                        std::vector<ChunkBrick>& out) const = 0;
};

/// Puts the closed pieces and the number of levels in `grid`. Groups are joined by the sum of the agreement
/// of their bricks, best supported first, as faces are within a part; then most of the area that visibility
/// has oriented says which side is outside, and looks_down() where there is none, or the piece is open. Reads
/// all own bricks twice, a level of a chunk at a time. Errors of reading. O(bricks).
[[nodiscard]] Result<JoinedChunks> join_chunks(const StoredChunks& stored, BrickGrid& grid, bool both_sides,
                                               int threads);

}  // namespace palpate::spline_sdf
