// Distances at a tile's nodes where patches agree: their mean, weighted by the distance of the node's foot
// from each centre. At edges and between sheets PatchDistanceField decides.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/spline_sdf/brick_grid.h"
#include "toolkit/spline_sdf/fit_patches.h"
#include "toolkit/spline_sdf/patch_lanes.h"

namespace palpate::render {

/// A tile holds a brick lattice's nodes from 4 (x, y, z) - 1 on: (x, y, z) at (x * 4 + y) * 4 + z.
inline constexpr int kTileNodes = kBrickCells;
inline constexpr std::size_t kTileCount = 64;
/// From a tile's middle to its outermost nodes, voxels.
inline constexpr double kTileReach = 1.5 * 1.7320509;
using Tile = std::array<float, kTileCount>;
/// Nodes 8 i to 8 i + 7 of a tile, from its middle, voxels.
[[gnu::always_inline]] inline NodePlaces tile_places(std::size_t i) noexcept {
  constexpr NodeLanes kY{-1.5f, -1.5f, -1.5f, -1.5f, -0.5f, -0.5f, -0.5f, -0.5f};
  constexpr NodeLanes kZ{-1.5f, -0.5f, 0.5f, 1.5f, -1.5f, -0.5f, 0.5f, 1.5f};
  return {NodeLanes{} + (static_cast<float>(i / 2) - 1.5f), kY + static_cast<float>(2 * (i % 2)), kZ};
}

/// The patches that may reach each tile; `codes`: of the tiles, in order. Immutable. O(patches x tiles near).
class TilePatches {
 public:
  TilePatches() = default;
  TilePatches(std::span<const QuadricPatch> patches, const BrickGrid& grid,
              const search::MortonCellTable& tiles, std::span<const std::uint64_t> codes, double voxel_mm,
              int threads);
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t tile) const noexcept {
    return {patch_.data() + begin_[tile], begin_[tile + 1] - begin_[tile]};
  }

 private:
  std::vector<std::uint32_t> begin_, patch_;
};

/// Distances in voxels at the nodes of the tile about `middle`, mm. False without patches, or if their
/// standard deviation at a node exceeds the tolerance. O(patches).
[[nodiscard]] bool blend_tile(std::span<const QuadricPatch> patches, std::span<const std::uint32_t> here,
                              const Vec3& middle, double voxel_mm, double tolerance_mm, Tile& out);

}  // namespace palpate::render
