// Bricks under construction: where they are needed, and which pieces are felt from one side.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "toolkit/spline_sdf/brick_grid.h"
#include "toolkit/spline_sdf/fit_patches.h"

namespace palpate::spline_sdf {

/// Half the diagonal of a cell in voxels: the largest distance from a cell's centre to a surface that crosses
/// it at unit gradient, with a margin.
inline constexpr double kCrossedCell = 1.1 * 0.8660254, kMinSlope = 0.5;

/// A brick and the data that classify its piece.
struct BuiltBrick {
  Brick brick;
  std::uint64_t beyond = 0;  ///< crossed cells without points around
  std::uint32_t piece = 0;
  bool smaller = false;  ///< does not follow the field
  /// Sums over crossed cells: normals, and places from the cube's corner in voxels of its level.
  Vec3 normals = Vec3::Zero(), places = Vec3::Zero();
};

/// Per level: the cubes' codes, ascending, and their bricks.
using LevelCodes = std::array<std::vector<std::uint64_t>, BrickGrid::kMaxLevels>;
using BuiltBricks = std::array<std::vector<BuiltBrick>, BrickGrid::kMaxLevels>;

/// Part of a brick in its piece.
struct BrickSummary {
  geometry::AreaElement part;  ///< of its surface, voxels
  std::uint32_t piece = 0;
  std::uint8_t cells = 0, beyond = 0;  ///< crossed cells with points around, and without
  bool smaller = false;
};
[[nodiscard]] BrickSummary summary_of(const BuiltBrick& one, std::uint64_t code, int level,
                                      const BrickGrid& grid);

/// Class of a piece, by which it is felt.
struct PieceClass {
  std::uint16_t number = 0;  ///< Brick::piece
  bool tight = false;

  void put(Brick& brick) const noexcept {
    brick.piece = number;
    if (tight) brick.mask = ~std::uint64_t{0};
  }
};

/// Parts joined within cubes of an edge from the lattice's corner, those of a cube that look the way of its
/// first apart from those against it: seen from afar the same. By the cubes' Morton codes. O(n log n).
[[nodiscard]] std::vector<geometry::AreaElement> joined_in_cubes(std::span<const geometry::AreaElement> parts,
                                                                 double edge);

/// Doublings from the largest bricks to a cube whose parts are joined: so small that a start a few
/// voxels off the surface still sees its side.
inline constexpr int kJoinedBits = 2;
/// Parts held at once, 200 MB with room to grow: the bricks of 100 million points. Beyond them those of
/// pieces with many are joined.
inline constexpr std::size_t kMostParts = std::size_t{1} << 22;

using VisitSummary = std::function<void(const BrickSummary& brick, int level)>;
/// Finds the pieces felt from one side: those without a border, and (unless `both_sides`) those that enclose
/// a volume despite holes; puts them in the grid and returns the class of each piece. `pieces`: 1 + the
/// largest BrickSummary::piece. `each_brick` visits all, level after level by code. `most_parts`: held at
/// once. O(bricks).
[[nodiscard]] std::vector<PieceClass> find_closed_components(
    BrickGrid& grid, std::size_t pieces, const std::function<void(const VisitSummary&)>& each_brick,
    bool both_sides, int threads, std::size_t most_parts = kMostParts);

[[nodiscard]] inline std::uint64_t morton_code_of(const BrickGrid::Coordinate& c) {
  return search::morton_code(static_cast<std::uint32_t>(c[0]), static_cast<std::uint32_t>(c[1]),
                             static_cast<std::uint32_t>(c[2]));
}
/// Ascending, without repetition.
void sort_unique(std::vector<std::uint64_t>& codes, int threads);

/// The tiles that hold the nodes of some bricks, ascending. O(bricks).
[[nodiscard]] std::vector<std::uint64_t> tiles_of(std::span<const std::uint64_t> bricks, int threads);
/// Adds the tiles of other bricks that share a face with one of these; `bricks`: all of the level. O(tiles).
void add_tiles_beside(const search::MortonCellTable& bricks, int threads, std::vector<std::uint64_t>& tiles);

/// Halvings from the spacing that half the surface's area exceeds to that of most points; 0 if equal. O(n log
/// n).
[[nodiscard]] int coarser_levels(const MortonPoints& points, std::span<const PointPatches> of_points);

/// Adds the codes of wanted cubes of a level that points lie in or near. O(points).
void add_cubes_near_points(const MortonPoints& points, std::span<const PointPatches> of_points,
                           const BrickGrid& grid, int level, int threads,
                           const std::function<bool(std::uint64_t)>& wanted,
                           std::vector<std::uint64_t>& codes);

}  // namespace palpate::spline_sdf
