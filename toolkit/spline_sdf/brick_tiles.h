// A smooth surface cut into tiles: octree nodes of at most kTileBricks bricks, each with the tree that finds
// its bricks. A tile is what a prepared file stores and what a loader brings near the HIP.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/bytes.h"
#include "toolkit/spline_sdf/brick_grid.h"

namespace palpate::spline_sdf {

/// Bricks of a tile, at most: 60 to 200 kB in a file, unpacked in a millisecond. A frame hears of a few
/// tiles, so that smaller ones would come too late to a fast hand.
inline constexpr std::size_t kTileBricks = 1024;
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

/// Bytes of a brick as it is: its 343 distances, piece and mask; little-endian.
inline constexpr std::size_t kStoredBrickBytes = kBrickCoefficients * 2 + 2 + 8;
void write_stored_brick(const Brick& brick, ByteWriter& to) noexcept;
/// Reads the stored brick at the front of `from`.
void read_stored_brick(std::span<const std::byte> from, Brick& out) noexcept;

/// Memory of a tile.
struct TileSize {
  std::uint32_t groups = 0, bricks = 0;

  bool operator==(const TileSize&) const = default;
};
/// A brick's way from the root needs a group a depth; the root has one of its own.
[[nodiscard]] constexpr std::uint32_t most_groups(std::uint32_t bricks) noexcept {
  return bricks * std::uint32_t{search::kMortonBits} + 1;
}
/// A tile in memory. Nodes count its own groups and bricks.
struct UnpackedTile {
  std::vector<TileNode> nodes;
  std::vector<Brick> bricks;

  [[nodiscard]] TileSize size() const noexcept {
    return {static_cast<std::uint32_t>(nodes.size() / kGroupNodes),
            static_cast<std::uint32_t>(bricks.size())};
  }
};

/// Numbers of groups and bricks, before a packed rest.
inline constexpr std::size_t kTileHeadBytes = 8;

/// Packs tiles for a file into a tenth to a quarter of their memory, without loss. Bricks beside each other
/// share nodes, which are stored once; each node is predicted from those before it (Ibarria et al. 2003), and
/// the small differences are packed by zstd. Keeps its memory between tiles; one thread at a time.
class TileCoder {
 public:
  TileCoder();
  ~TileCoder();
  TileCoder(TileCoder&&) noexcept;
  TileCoder& operator=(TileCoder&&) noexcept;

  /// `bricks`: those of the tile, in order. Error: too little memory. O(bricks).
  [[nodiscard]] Result<std::vector<std::byte>> pack(const BrickTile& tile, std::span<const Brick> bricks);
  /// An Error, with no file's name, where an image is not whole or leads astray: every group and brick is
  /// reached once, and none is of a piece that does not exist. O(bricks).
  [[nodiscard]] Status unpack(std::span<const std::byte> image, TileKey key, const BrickGrid& grid,
                              UnpackedTile& out);

 private:
  class Work;
  std::unique_ptr<Work> work_;
};

}  // namespace palpate::spline_sdf
