// The smooth surface as frames read it: bricks of 4 x 4 x 4 cells, each with the 7 x 7 x 7 coefficients of
// its own uniform cubic B-spline of distance. A brick belongs to one sheet: two sheets that pass through one
// cube have two bricks there, and never one number in common.
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
/// Half of its cells and half of its nodes along an axis, and half the diagonal of its cells, voxels.
inline constexpr double kHalfCells = 0.5 * kBrickCells, kHalfNodes = 0.5 * (kBrickNodes - 1);
inline constexpr double kHalfDiagonal = 3.4641016;
inline constexpr int kBrickCoefficients = kBrickNodes * kBrickNodes * kBrickNodes;
/// Largest distance that a coefficient holds, in voxels: a brick's nodes are at most 5.2 from its middle.
inline constexpr double kBrickReach = 8.0;
inline constexpr float kBrickUnit = static_cast<float>(kBrickReach / 32767.0);
/// What a distance read from a brick is off by at most, voxels: it is summed in single precision, of products
/// of three weights (a polynomial of four operations each) and a coefficient no larger than kBrickReach, in
/// three sums of four one in another: 12 + 3 + 9 roundings.
inline constexpr double kReadRounding = 24.0 * kUnitRoundoffFloat * kBrickReach;

/// How a brick's sheet goes on with the next brick: where its faces meet in creases each is a layer of its
/// own. Those that meet in ridges are one body, of which the greatest distance counts; of bodies the least.
enum class Joint : std::uint8_t {
  kLast,    ///< the sheet's last layer; mostly its only one
  kRidge,   ///< the next is of the same body
  kValley,  ///< the next begins another body
  kSeam,    ///< the next is the last, and counts beyond where the two touch: see Brick::is_past()
};
/// Layers of a sheet in a cube, at most.
inline constexpr int kMostLayers = 4;

/// Coefficient (x, y, z) at (x * 7 + y) * 7 + z; node 0 is one voxel before the brick's corner. The mask has
/// a bit for each cell, (x * 4 + y) * 4 + z, through which the surface goes and points are near; of a sheet
/// with layers it is the first brick's that counts.
struct Brick {
  std::array<std::int16_t, kBrickCoefficients> distance;
  std::uint16_t tag = 0;
  std::uint64_t mask = 0;

  static constexpr int kPieceBits = 14;
  /// Of BrickGrid::closed_pieces, from 1; 0: an open sheet, felt from both sides.
  [[nodiscard]] std::uint16_t piece() const noexcept {
    return static_cast<std::uint16_t>(tag & ((1u << kPieceBits) - 1u));
  }
  [[nodiscard]] Joint joint() const noexcept { return static_cast<Joint>(tag >> kPieceBits); }
  /// Of a seam's second brick, and of the third where two cross, in its mask: the line beyond which it
  /// counts. `at` in voxels from the corner of the brick's cells. Exact to 0.0003 voxels.
  [[nodiscard]] bool is_past(const std::array<float, 3>& at) const noexcept {
    const auto part = [&](unsigned shift) {
      return static_cast<float>(static_cast<std::int16_t>(mask >> shift));
    };
    return part(0) * at[0] + part(16) * at[1] + part(32) * at[2] > static_cast<float>(kBrickReach) * part(48);
  }
  void set_line(const Vec3& across, double off) noexcept {
    mask = 0;
    const auto put = [&](double x, unsigned shift) {
      const auto whole = static_cast<std::int16_t>(std::lround(x * 32767.0));
      mask |= static_cast<std::uint64_t>(static_cast<std::uint16_t>(whole)) << shift;
    };
    for (unsigned a = 0; a < 3; ++a) put(across[a], 16 * a);
    put(std::clamp(off / kBrickReach, -1.0, 1.0), 48);
  }
  /// Distances at the nodes, voxels: cut off at kBrickReach, rounded to kBrickUnit.
  void put(const std::array<float, kBrickCoefficients>& at_nodes) noexcept {
    constexpr auto kLargest = static_cast<float>(kBrickReach);
    for (std::size_t i = 0; i < at_nodes.size(); ++i) {
      const float units = std::clamp(at_nodes[i], -kLargest, kLargest) / kBrickUnit;
      distance[i] = static_cast<std::int16_t>(units + (units < 0.0f ? -0.5f : 0.5f));
    }
  }
  void set(std::uint16_t piece, Joint joint) noexcept {
    tag = static_cast<std::uint16_t>(piece | static_cast<unsigned>(joint) << kPieceBits);
  }
};
/// Layers of the sheet whose first brick this is.
[[nodiscard]] inline std::uint32_t layers_from(const Brick* first) noexcept {
  std::uint32_t count = 1;
  for (; first->joint() != Joint::kLast; ++first) ++count;
  return count;
}

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
  CellBlocks table;                  ///< from a brick coordinate's Morton code to its cell
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
      if (a < 0 || a > last_brick) return CellBlocks::kNone;
    return table.find(partition::morton_code(static_cast<std::uint32_t>(c[0]),
                                             static_cast<std::uint32_t>(c[1]),
                                             static_cast<std::uint32_t>(c[2])));
  }
};

}  // namespace palpate::render
