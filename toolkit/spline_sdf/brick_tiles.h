// A smooth surface cut into tiles: octree nodes of at most kTileBricks bricks, each with the tree that finds
// its bricks. A tile is what a prepared file stores and what a loader brings near the HIP.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/bytes.h"
#include "toolkit/spline_sdf/brick_grid.h"

namespace palpate::spline_sdf {

/// Bricks of a tile, at most: some 180 kB, which an SSD reads as fast as smaller pieces.
inline constexpr std::size_t kTileBricks = 256;
/// A group holds the eight children of a node.
inline constexpr std::uint32_t kGroupNodes = 8;

/// A node of a tile's tree. Nodes above the largest bricks have none.
struct TileNode {
  std::uint32_t brick = BrickGrid::kNone;
  std::uint32_t children = 0;  ///< number of their group; 0: none
};

/// A node of the octree over all bricks. At depth search::kMortonBits stand the smallest bricks that the grid
/// may have; a level-l brick is at depth_of_level(grid, l).
struct TileKey {
  std::uint64_t code = 0;  ///< Morton code among the nodes of its depth
  int depth = 0;

  bool operator==(const TileKey&) const = default;
  /// The smallest code of depth kMortonBits in it: the order of tiles in a file.
  [[nodiscard]] std::uint64_t first_code() const noexcept {
    return code << (3 * (search::kMortonBits - depth));
  }
};

[[nodiscard]] inline int depth_of_level(const BrickGrid& grid, int level) noexcept {
  return search::kMortonBits - (grid.levels - 1 - level);
}
/// Edge of a node of this depth, voxels.
[[nodiscard]] inline double node_edge(const BrickGrid& grid, int depth) noexcept {
  return std::ldexp(grid.cube_edge(), depth_of_level(grid, 0) - depth);
}

struct BrickTile {
  TileKey key;
  /// Group 0 has the root as its first node and seven unused ones.
  std::vector<TileNode> nodes;
  std::vector<std::uint32_t> bricks;  ///< numbers in the grid; TileNode::brick counts these
};

/// A brick by its place alone, for surfaces whose bricks are not in memory.
struct PlacedBrick {
  TileKey key;
  std::uint32_t brick = 0;  ///< any number
};
/// A node before what lies in it.
void sort_placed(std::vector<PlacedBrick>& bricks);

/// Takes what cutting gives; its errors end the cutting.
struct TileSink {
  std::function<Status(const BrickTile&)> tile;  ///< by first_code()
  /// Bricks above the tiles, where more than kTileBricks smaller ones replace one.
  std::function<Status(const PlacedBrick&)> above;
};
/// `sorted`: all bricks in the node. O(bricks). The same for any number of threads of the build.
[[nodiscard]] Status cut_into_tiles(TileKey node, std::span<const PlacedBrick> sorted, const TileSink& sink);
[[nodiscard]] Status cut_into_tiles(const BrickGrid& grid, const TileSink& sink);

/// Gives bricks by their numbers.
using BrickSource = std::function<Status(std::uint32_t number, Brick& brick)>;
/// Those of a grid, which outlives the source.
[[nodiscard]] BrickSource bricks_of(const BrickGrid& grid);

/// A tile as stored: numbers of groups and bricks, the nodes, the bricks; little-endian. Errors of the
/// source.
[[nodiscard]] Result<std::vector<std::byte>> tile_image(const BrickTile& tile, const BrickSource& bricks);
void write_stored_brick(const Brick& brick, ByteWriter& to) noexcept;

/// Memory of a tile, read from its image's first bytes.
struct TileSize {
  std::uint32_t groups = 0, bricks = 0;
};
/// An Error, with no file's name, where an image is not whole or leads astray: every node is reached once, no
/// brick is beyond the tile or of a piece that does not exist.
[[nodiscard]] Result<TileSize> check_tile_image(std::span<const std::byte> image, TileKey key,
                                                const BrickGrid& grid);

/// Unpacks a checked image. `group_at` and `brick_at` give the places of the tile's own groups and bricks.
template <class GroupAt, class BrickAt>
void unpack_tile(std::span<const std::byte> image, std::span<TileNode> nodes, std::span<Brick> bricks,
                 GroupAt&& group_at, BrickAt&& brick_at);

/// Bytes of a stored brick: its 343 distances, piece and mask.
inline constexpr std::size_t kStoredBrickBytes = kBrickCoefficients * 2 + 2 + 8;
inline constexpr std::size_t kStoredNodeBytes = 8, kTileHeadBytes = 8;

/// Reads the stored brick at the front of `from`.
void read_stored_brick(std::span<const std::byte> from, Brick& out) noexcept;
[[nodiscard]] TileNode read_stored_node(std::span<const std::byte> from) noexcept;

template <class GroupAt, class BrickAt>
void unpack_tile(std::span<const std::byte> image, std::span<TileNode> nodes, std::span<Brick> bricks,
                 GroupAt&& group_at, BrickAt&& brick_at) {
  const TileNode head = read_stored_node(image);  // two numbers, as a node has
  std::size_t at = kTileHeadBytes;
  for (std::uint32_t g = 0; g < head.brick; ++g)
    for (std::uint32_t k = 0; k < kGroupNodes; ++k, at += kStoredNodeBytes) {
      TileNode node = read_stored_node(image.subspan(at));
      if (node.brick != BrickGrid::kNone) node.brick = brick_at(node.brick);
      if (node.children != 0) node.children = group_at(node.children);
      nodes[std::size_t{group_at(g)} * kGroupNodes + k] = node;
    }
  for (std::uint32_t b = 0; b < head.children; ++b, at += kStoredBrickBytes)
    read_stored_brick(image.subspan(at), bricks[brick_at(b)]);
}

}  // namespace palpate::spline_sdf
