// Bricks while they are made, and which of them are pieces that are felt from one side.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toolkit/smooth/brick_grid.h"

namespace palpate::render {

/// Half the diagonal of a cell, in voxels: a cell's middle is at most so far off a surface that crosses it,
/// where the gradient is one; with room for where it is not quite.
inline constexpr double kCrossedCell = 1.1 * 0.8660254, kLeastSlope = 0.5;

/// One brick and what decides about its piece.
struct Made {
  Brick brick;
  std::uint64_t beyond = 0;  ///< cells that the surface goes through where no points are around
  std::uint32_t piece = 0;
  bool smaller = false;  ///< it does not follow the field
  /// Of the cells that the surface goes through: sums of the normals, and of the places from the cube's
  /// corner, in voxels of its level.
  Vec3 normals = Vec3::Zero(), places = Vec3::Zero();
};

/// Of each level: the codes of its cubes, rising, and what was made of them.
using LevelCodes = std::array<std::vector<std::uint64_t>, BrickGrid::kMostLevels>;
using MadeBricks = std::array<std::vector<Made>, BrickGrid::kMostLevels>;

/// Numbers the pieces that are felt from one side, those without a border and those that enclose a volume but
/// for holes (not with `both_sides`), in the grid and in the bricks. `pieces`: one more than the largest
/// number of a Made::piece. O(bricks).
void close_pieces(BrickGrid& grid, MadeBricks& made, const LevelCodes& codes, std::size_t pieces,
                  bool both_sides, int threads);

}  // namespace palpate::render
