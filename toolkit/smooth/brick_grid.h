// The smooth surface as frames read it: bricks of 4 x 4 x 4 cells, each with the 7 x 7 x 7 coefficients of a
// uniform cubic B-spline of distance. Where one brick cannot follow the surface (edges, thin parts), up to
// eight of half the size stand in its place, if need be again.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/geometry/enclosure.h"
#include "toolkit/smooth/smooth_points.h"

namespace palpate::render {

inline constexpr int kBrickCells = 4;
inline constexpr int kBrickNodes = kBrickCells + 3;
/// Half the diagonal of a brick's cells, voxels.
inline constexpr double kHalfDiagonal = 3.4641016;
inline constexpr int kBrickCoefficients = kBrickNodes * kBrickNodes * kBrickNodes;
/// Largest distance that a coefficient holds, in voxels: a brick's nodes are at most 5.2 from its middle.
inline constexpr double kBrickReach = 8.0;
inline constexpr float kBrickUnit = static_cast<float>(kBrickReach / 32767.0);
/// What a distance read from a brick is off by at most, voxels: it is summed in single precision, of products
/// of three weights (a polynomial of four operations each) and a coefficient no larger than kBrickReach, in
/// three sums of four one in another: 12 + 3 + 9 roundings.
inline constexpr double kReadRounding = 24.0 * kUnitRoundoffFloat * kBrickReach;

/// Coefficient (x, y, z) at (x * 7 + y) * 7 + z; node 0 is one voxel before the brick's corner. Distances are
/// in voxels of the brick's own size. The mask has a bit for each cell, (x * 4 + y) * 4 + z, where the
/// surface may be touched; all of them in a tight piece.
struct Brick {
  std::array<std::int16_t, kBrickCoefficients> distance;
  std::uint16_t piece = 0;  ///< of BrickGrid::closed_pieces, from 1; 0: an open sheet, felt from both sides
  std::uint64_t mask = 0;

  /// Distances at the nodes, voxels: cut off at kBrickReach, rounded to kBrickUnit.
  void put(const std::array<float, kBrickCoefficients>& at_nodes) noexcept {
    constexpr auto kLargest = static_cast<float>(kBrickReach);
    for (std::size_t i = 0; i < at_nodes.size(); ++i) {
      const float units = std::clamp(at_nodes[i], -kLargest, kLargest) / kBrickUnit;
      distance[i] = static_cast<std::int16_t>(units + (units < 0.0f ? -0.5f : 0.5f));
    }
  }
};

/// A piece that is felt from one side: that on which a replay begins.
struct ClosedPiece {
  float outer_side = 1.0f;                   ///< the sign of the distance outside
  bool tight = true;                         ///< without a mouth that a HIP could come in through
  std::vector<geometry::SurfacePart> parts;  ///< its surface brick by brick, voxels
};

/// All bricks of a model. Immutable and shared; local mm. A voxel is one of level `coarser`.
struct BrickGrid {
  static constexpr std::uint32_t kNone = CellBlocks::kNone;
  /// A bit beside a brick's number: smaller ones stand in its place where the surface goes.
  static constexpr std::uint32_t kSmaller = 1u << 31;
  /// Sizes of bricks, each half of the last: so many from one voxel of the points' spacing on, and before
  /// them larger ones for what is sampled more coarsely than most.
  static constexpr int kFineLevels = 3, kMostCoarser = 8, kMostLevels = kMostCoarser + kFineLevels;
  using Coordinate = std::array<std::int32_t, 3>;

  struct Level {
    CellBlocks table;                  ///< from a brick coordinate's Morton code to its cell
    std::vector<std::uint32_t> brick;  ///< of each cell; with kSmaller where the next level has some
  };
  /// Where a brick stands: its coordinate in bricks of its level.
  struct Place {
    std::uint32_t brick = kNone;
    int level = 0;
    Coordinate cube{};
    bool whole = true;  ///< no smaller one stands anywhere in its cube
  };

  Vec3 low_mm = Vec3::Zero();   ///< corner of brick (0, 0, 0)
  double voxel_mm = 1.0;        ///< of level `coarser`
  int coarser = 0;              ///< levels of larger voxels than that
  double per_voxel = 1.0;       ///< 1 / voxel_mm
  std::int64_t last_brick = 0;  ///< largest brick coordinate of any axis, of level 0
  int levels = 1;
  std::array<Level, kMostLevels> level;
  LargeVector<Brick> bricks;
  geometry::Aabb box_mm;  ///< of the points
  std::vector<ClosedPiece> closed_pieces;
  double least_enclosed = 1.0;  ///< 1 less the widest geometry::mouth_share() of those with holes

  [[nodiscard]] std::size_t bytes() const noexcept {
    std::size_t sum = bricks.capacity() * sizeof(Brick) + closed_pieces.capacity() * sizeof(ClosedPiece);
    for (const ClosedPiece& piece : closed_pieces)
      sum += piece.parts.capacity() * sizeof(geometry::SurfacePart);
    for (const Level& l : level) sum += l.table.bytes() + l.brick.capacity() * sizeof(std::uint32_t);
    return sum;
  }
  /// Voxels of a level in one voxel: a power of two.
  [[nodiscard]] double per_voxel_of(int level_of) const noexcept {
    return kPerVoxel[static_cast<std::size_t>(level_of - coarser + kMostCoarser)];
  }
  /// Edge of the largest cubes, voxels.
  [[nodiscard]] double cube_edge() const noexcept { return kBrickCells / per_voxel_of(0); }
  /// In voxels from low_mm.
  [[nodiscard]] Vec3 in_voxels(const Vec3& local_mm) const noexcept {
    return (local_mm - low_mm) * per_voxel;
  }
  /// The smallest brick at a place, in voxels. Where there is none its `brick` is kNone, and the cube of
  /// level 0 there holds nothing. O(levels).
  [[nodiscard]] Place find(const Vec3& at) const noexcept {
    Place out;
    for (int l = 0; l < levels; ++l) {
      const double per = per_voxel_of(l) * (1.0 / kBrickCells);
      Coordinate cube;
      for (std::size_t a = 0; a < 3; ++a) {
        const double x = std::floor(at[static_cast<Eigen::Index>(a)] * per);
        if (!(x >= 0.0 && x <= static_cast<double>(((last_brick + 1) << l) - 1))) return out;
        cube[a] = static_cast<std::int32_t>(x);
      }
      const Level& here = level[static_cast<std::size_t>(l)];
      const std::uint32_t cell = here.table.find(partition::morton_code(static_cast<std::uint32_t>(cube[0]),
                                                                        static_cast<std::uint32_t>(cube[1]),
                                                                        static_cast<std::uint32_t>(cube[2])));
      if (cell == kNone) return out;
      out = {here.brick[cell] & ~kSmaller, l, cube, (here.brick[cell] & kSmaller) == 0};
      if (out.whole) return out;
    }
    return out;
  }
  static constexpr std::array<double, kMostLevels> kPerVoxel = [] {
    std::array<double, kMostLevels> per{};
    double value = 1.0 / (1 << kMostCoarser);
    for (double& one : per) {
      one = value;
      value *= 2.0;
    }
    return per;
  }();
  /// Of every brick, in their order. O(bricks).
  [[nodiscard]] std::vector<Place> places() const;
};

}  // namespace palpate::render
