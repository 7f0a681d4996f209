// The smooth surface as frames read it: bricks of 4 x 4 x 4 cells, each with the 7 x 7 x 7 coefficients of
// its own uniform cubic B-spline of distance. A brick belongs to one sheet: two sheets that pass through one
// cube have two bricks there, and never one number in common.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/geometry/enclosure.h"
#include "toolkit/smooth/smooth_points.h"

namespace palpate::render {

inline constexpr int kBrickCells = 4;
inline constexpr int kBrickNodes = kBrickCells + 3;
inline constexpr int kBrickCoefficients = kBrickNodes * kBrickNodes * kBrickNodes;
/// Largest distance that a coefficient holds, in voxels: a brick's nodes are at most 5.2 from its middle.
inline constexpr double kBrickReach = 8.0;
inline constexpr float kBrickUnit = static_cast<float>(kBrickReach / 32767.0);

/// Coefficient (x, y, z) at (x * 7 + y) * 7 + z; node 0 is one voxel before the brick's corner. The mask has
/// a bit for each cell, (x * 4 + y) * 4 + z, through which the surface goes and points are near.
struct Brick {
  std::array<std::int16_t, kBrickCoefficients> distance;
  std::uint16_t piece = 0;  ///< of BrickGrid::closed_pieces, from 1; 0: an open sheet, felt from both sides
  std::uint64_t mask = 0;
};

/// Places of a closed piece that decide, by majority, which of its sides is free.
inline constexpr std::size_t kPieceSamples = 5;

/// A piece that is felt from one side: which, is found out where a replay begins.
struct ClosedPiece {
  ClosedPiece() { samples.fill(Eigen::Vector3f::Zero()); }
  /// Of one without holes places on it, in voxels: towards them it is seen which side of it is free.
  std::array<Eigen::Vector3f, kPieceSamples> samples;
  /// Of one with holes the sign of the distance outside, and its surface brick by brick; else 0 and none.
  float outer_side = 0.0f;
  std::vector<geometry::SurfacePart> parts;
};

/// All bricks of a model. Immutable and shared; local mm.
struct BrickGrid {
  Vec3 low_mm = Vec3::Zero();  ///< corner of brick (0, 0, 0)
  double voxel_mm = 1.0;
  double per_voxel = 1.0;            ///< 1 / voxel_mm
  std::int64_t last_brick = 0;       ///< largest brick coordinate of any axis
  CellTable table;                   ///< from a brick coordinate's Morton code to its cell
  std::vector<std::uint32_t> first;  ///< brick of each cell, and one more
  LargeVector<Brick> bricks;
  geometry::Aabb box_mm;  ///< of the points
  std::vector<ClosedPiece> closed_pieces;
  double least_enclosed = 1.0;  ///< 1 less the widest geometry::mouth_share() of those with holes

  using Coordinate = std::array<std::int32_t, 3>;
  [[nodiscard]] std::size_t bytes() const noexcept {
    std::size_t parts = 0;
    for (const ClosedPiece& piece : closed_pieces) parts += piece.parts.capacity();
    return table.bytes() + first.capacity() * sizeof(std::uint32_t) + bricks.capacity() * sizeof(Brick) +
           closed_pieces.capacity() * sizeof(ClosedPiece) + parts * sizeof(geometry::SurfacePart);
  }
  /// Of every brick. O(bricks).
  [[nodiscard]] std::vector<Coordinate> cubes_of_bricks() const;
  /// In voxels from low_mm.
  [[nodiscard]] Vec3 in_voxels(const Vec3& local_mm) const noexcept {
    return (local_mm - low_mm) * per_voxel;
  }
  /// The cell of a brick coordinate, or kNone.
  [[nodiscard]] std::uint32_t cell_at(const Coordinate& c) const noexcept {
    for (const std::int32_t a : c)
      if (a < 0 || a > last_brick) return CellTable::kNone;
    return table.find(partition::morton_code(static_cast<std::uint32_t>(c[0]),
                                             static_cast<std::uint32_t>(c[1]),
                                             static_cast<std::uint32_t>(c[2])));
  }
};

}  // namespace palpate::render
