// The smooth surface as frames read it: bricks of 4 x 4 x 4 cells with 7 x 7 x 7 coefficients of a uniform
// cubic B-spline of signed distance. Where a brick cannot follow the surface (edges, thin parts) up to eight
// half-size bricks replace it, recursively.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/vec.h>
#include "toolkit/core/hardware.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/winding_number.h"
#include "toolkit/search/morton_order.h"

namespace palpate::spline_sdf {

inline constexpr int kBrickCells = 4;
inline constexpr int kBrickNodes = kBrickCells + 3;
/// Half the diagonal of a brick's cells, voxels.
inline constexpr double kHalfDiagonal = 3.4641016;
inline constexpr int kBrickCoefficients = kBrickNodes * kBrickNodes * kBrickNodes;
/// Largest representable distance in voxels; a brick's nodes are at most 5.2 from its centre.
inline constexpr double kMaxBrickDistance = 8.0;
inline constexpr float kDistanceUnit = static_cast<float>(kMaxBrickDistance / 32767.0);
/// Bound on the error of a distance read from a brick, in voxels. It is a single-precision sum of products of
/// three weights (polynomials of four operations) and a coefficient up to kMaxBrickDistance, in three nested
/// sums of four: 12 + 3 + 9 roundings.
inline constexpr double kReadRounding = 24.0 * kUnitRoundoffFloat * kMaxBrickDistance;

/// Coefficient (x, y, z) is at (x * 7 + y) * 7 + z; node 0 is one voxel before the brick's corner. Distances
/// are in voxels of the brick's size. The mask has a bit per cell, (x * 4 + y) * 4 + z, set where the surface
/// may be touched; all are set in a tight piece.
struct Brick {
  std::array<std::int16_t, kBrickCoefficients> distance;
  std::uint16_t piece =
      0;  ///< of BrickGrid::closed_components, from 1; 0: an open sheet, felt from both sides
  std::uint64_t mask = 0;

  /// Stores distances at the nodes in voxels, clamped to kMaxBrickDistance and rounded to kDistanceUnit.
  void put(const std::array<float, kBrickCoefficients>& at_nodes) noexcept {
    constexpr auto kLargest = static_cast<float>(kMaxBrickDistance);
    for (std::size_t i = 0; i < at_nodes.size(); ++i) {
      const float units = std::clamp(at_nodes[i], -kLargest, kLargest) / kDistanceUnit;
      distance[i] = static_cast<std::int16_t>(units + (units < 0.0f ? -0.5f : 0.5f));
    }
  }
};

/// A piece felt from one side, the side of the replay's start.
struct ClosedComponent {
  float normal_orientation = 1.0f;  ///< sign of the distance outside
  bool tight = true;                ///< has no opening that a HIP could enter
  geometry::SurfaceParts parts;     ///< its surface, one part per brick, voxels
};

class TileWindow;  // tile_window.h

/// All bricks of a model. Immutable and shared; local mm. The voxel is that of level `coarser`.
struct BrickGrid {
  static constexpr std::uint32_t kNone = search::MortonCellTable::kNone;
  /// Flag on a brick's number: smaller bricks replace it where the surface is.
  static constexpr std::uint32_t kRefined = 1u << 31;
  /// Brick sizes, each half the last: kFineLevels from the points' spacing down, and up to kMaxCoarser larger
  /// ones for sparser parts.
  static constexpr int kFineLevels = 3, kMaxCoarser = 8, kMaxLevels = kMaxCoarser + kFineLevels;
  using Coordinate = std::array<std::int32_t, 3>;

  struct Level {
    search::MortonCellTable table;     ///< from a brick coordinate's Morton code to its cell
    std::vector<std::uint32_t> brick;  ///< per cell; kRefined if the next level has bricks there
  };
  /// A brick and its coordinate in bricks of its level.
  struct BrickRef {
    std::uint32_t brick = kNone;
    int level = 0;
    Coordinate cube{};
    bool whole = true;  ///< no smaller brick in its cube
  };

  Vec3 low_mm = Vec3::Zero();   ///< corner of brick (0, 0, 0)
  double voxel_mm = 1.0;        ///< of level `coarser`
  int coarser = 0;              ///< number of levels with larger voxels
  double per_voxel = 1.0;       ///< 1 / voxel_mm
  std::int64_t last_brick = 0;  ///< largest level-0 brick coordinate on any axis
  int levels = 1;
  std::array<Level, kMaxLevels> level;
  LargePageUninitializedVector<Brick> bricks;
  geometry::Aabb box_mm;  ///< of the points
  /// Finds what is not in the tables, in a surface larger than memory; else null.
  const TileWindow* window = nullptr;
  std::vector<ClosedComponent> closed_components;
  double min_enclosed = 1.0;  ///< 1 - the widest geometry::opening_fraction() of pieces with holes

  [[nodiscard]] std::size_t bytes() const noexcept {
    std::size_t sum =
        bricks.capacity() * sizeof(Brick) + closed_components.capacity() * sizeof(ClosedComponent);
    for (const ClosedComponent& piece : closed_components) sum += piece.parts.bytes();
    for (const Level& l : level) sum += l.table.bytes() + l.brick.capacity() * sizeof(std::uint32_t);
    return sum;
  }
  /// Level voxels per voxel: a power of two.
  [[nodiscard]] double per_voxel_of(int level_of) const noexcept {
    return kPerVoxel[static_cast<std::size_t>(level_of - coarser + kMaxCoarser)];
  }
  /// Edge of the largest cubes, voxels.
  [[nodiscard]] double cube_edge() const noexcept { return kBrickCells / per_voxel_of(0); }
  /// In voxels from low_mm.
  [[nodiscard]] Vec3 in_voxels(const Vec3& local_mm) const noexcept {
    return (local_mm - low_mm) * per_voxel;
  }
  /// The smallest brick at a place, in voxels. If its `brick` is kNone, the level-0 cube there is empty.
  /// O(levels).
  [[nodiscard]] BrickRef find(const Vec3& at) const noexcept {
    if (window != nullptr) [[unlikely]]
      return find_in_window(at);
    return find_in_tables(at);
  }
  /// The same through the window, where the tables have only the bricks above its tiles. In tile_window.cpp.
  [[nodiscard]] BrickRef find_in_window(const Vec3& at) const noexcept;
  /// The same by the tables alone.
  [[nodiscard]] BrickRef find_in_tables(const Vec3& at) const noexcept {
    BrickRef out;
    for (int l = 0; l < levels; ++l) {
      const double per = per_voxel_of(l) * (1.0 / kBrickCells);
      Coordinate cube;
      for (std::size_t a = 0; a < 3; ++a) {
        const double x = std::floor(at[static_cast<Eigen::Index>(a)] * per);
        if (!(x >= 0.0 && x <= static_cast<double>(((last_brick + 1) << l) - 1))) return out;
        cube[a] = static_cast<std::int32_t>(x);
      }
      const Level& here = level[static_cast<std::size_t>(l)];
      const std::uint32_t cell = here.table.find(search::morton_code(static_cast<std::uint32_t>(cube[0]),
                                                                     static_cast<std::uint32_t>(cube[1]),
                                                                     static_cast<std::uint32_t>(cube[2])));
      if (cell == kNone) return out;
      out = {here.brick[cell] & ~kRefined, l, cube, (here.brick[cell] & kRefined) == 0};
      if (out.whole) return out;
    }
    return out;
  }
  static constexpr std::array<double, kMaxLevels> kPerVoxel = [] {
    std::array<double, kMaxLevels> per{};
    double value = 1.0 / (1 << kMaxCoarser);
    for (double& one : per) {
      one = value;
      value *= 2.0;
    }
    return per;
  }();
  /// All bricks, in order. O(bricks).
  [[nodiscard]] std::vector<BrickRef> places() const;
};

}  // namespace palpate::spline_sdf
