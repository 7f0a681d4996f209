// The distance at the nodes of a tile where the patches agree: their mean, each weighed by how near its
// middle the node's foot is. Where they do not, at edges and between sheets, PatchField tells.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/cover.h"

namespace palpate::render {

/// A tile holds the nodes of a brick's lattice from 4 (x, y, z) - 1 on: (x, y, z) at (x * 4 + y) * 4 + z.
inline constexpr int kTileNodes = kBrickCells;
inline constexpr std::size_t kTileCount = 64;
/// From the middle of a tile to its outermost nodes, voxels.
inline constexpr double kTileReach = 1.5 * 1.7320509;
using Tile = std::array<float, kTileCount>;

/// Which patches may reach the nodes of each tile; `codes`: of the tiles, in their order. Immutable.
/// O(patches x tiles near).
class TilePatches {
 public:
  TilePatches() = default;
  TilePatches(std::span<const Patch> patches, const BrickGrid& grid, const CellBlocks& tiles,
              std::span<const std::uint64_t> codes, double voxel_mm, int threads);
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t tile) const noexcept {
    return {patch_.data() + begin_[tile], begin_[tile + 1] - begin_[tile]};
  }

 private:
  std::vector<std::uint32_t> begin_, patch_;
};

/// Distances in voxels at the nodes of the tile about `middle`, mm. False where there are no patches, or they
/// differ at a node by more than the tolerance (standard deviation). O(patches).
[[nodiscard]] bool blend_tile(std::span<const Patch> patches, std::span<const std::uint32_t> here,
                              const Vec3& middle, double voxel_mm, double tolerance_mm, Tile& out);

}  // namespace palpate::render
