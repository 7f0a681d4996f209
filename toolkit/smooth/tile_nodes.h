// Tiles of 4 x 4 x 4 nodes, and what a patch adds to them: eight nodes at once where the machine can, with
// the same bits where it cannot.
#pragma once

#include <array>
#include <cstddef>

namespace palpate::render {

/// Nodes along an edge of a tile, and of a tile: (x, y, z) at (x * 4 + y) * 4 + z, a voxel apart.
inline constexpr int kTileNodes = 4;
inline constexpr std::size_t kTileCount = std::size_t{kTileNodes} * kTileNodes * kTileNodes;

/// A patch in voxels, from the middle of a tile's nodes.
struct TilePatch {
  std::array<float, 3> at, u, v, n;
  float uu, uv, vv, trust, support, per_support_sq, sharpen, bend;
  /// By how much curvature may move a foot along the tangent plane.
  float foot_room;
};

/// Of each node: weights, and by them distances and gradients.
struct alignas(32) TileSums {
  std::array<float, kTileCount> weight, distance, x, y, z;
};

/// Adds one patch to the nodes that it reaches.
void add_to_tile(const TilePatch& patch, TileSums& sums);

}  // namespace palpate::render
