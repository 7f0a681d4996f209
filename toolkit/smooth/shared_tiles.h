// Distances to the patches of one face at the nodes of all bricks, tile by tile. Bricks beside each other
// have nodes in common: a tile is worked out once for all that ask for it with the same patches.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/cover.h"
#include "toolkit/smooth/tile_nodes.h"

namespace palpate::render {

/// Distance and gradient of a face at the nodes of one tile, in voxels; where it is not known, nothing.
struct Tile {
  // Not filled: all of it is written before it is read.
  Tile() noexcept {}  // NOLINT(cppcoreguidelines-pro-type-member-init,modernize-use-equals-default)
  std::array<float, kTileCount> distance, x, y, z;
  std::array<std::uint8_t, kTileCount> known;
};

/// How far from the middle of a cube's eight tiles, along its tangent plane and beyond its support, a patch
/// may be that one of them asks for, in voxels. Cubes with all such patches ask for the same ones in the
/// tiles that they have in common.
[[nodiscard]] double reach_of_tiles(const Vec3& normal);

/// Scratch that is used again from cube to cube. Belongs to one thread; what it answers depends on the
/// question alone, not on what was asked before.
class SharedTiles {
 public:
  /// Keeps references.
  SharedTiles(const std::vector<Patch>& patches, const BrickGrid& grid, const SmoothWithout& without)
      : patches_(patches), grid_(grid), without_(without), form_(patches.size(), kNone) {
    forget();
  }
  /// The patches that are asked for until the next call, by number.
  void take_face(std::span<const std::uint32_t> patches);
  /// Of tile (x, y, z), which has the nodes from 4 (x, y, z) - 1 on, in voxels from the grid's low corner.
  /// Good until the next call. O(patches of the face).
  [[nodiscard]] const Tile& at(const BrickGrid::Coordinate& place);

 private:
  /// A patch as tiles take it, worked out once.
  struct Form {
    Vec3 at = Vec3::Zero();                               ///< voxels from the grid's low corner
    double support = 0.0, tile_radius = 0.0, bend = 0.0;  ///< how far it may reach: see foot_room()
    TilePatch tile;                                       ///< but for what depends on the tile
  };
  struct Kept {
    Tile tile;
    BrickGrid::Coordinate place;
    std::uint32_t first, count;  ///< of its patches, in lists_
    std::uint32_t next;          ///< with the same hash
  };
  static constexpr std::uint32_t kNone = 0xffffffffu;
  static constexpr std::size_t kHeads = 1024;
  /// Kept at most, 5 MB: a chunk of bricks on a single sheet has some 600.
  static constexpr std::size_t kMostTiles = 4096;

  void forget();
  [[nodiscard]] const Form& form_of(std::uint32_t patch);
  /// The patches of the face whose support may reach a tile.
  void find_here(const BrickGrid::Coordinate& place);
  [[nodiscard]] bool same_patches(const Kept& kept) const;
  void work_out(const BrickGrid::Coordinate& place, Tile& tile) const;
  /// False where its support reaches no node of a tile with its middle there.
  [[nodiscard]] bool put_in_tile(std::uint32_t patch, const Vec3& middle, TilePatch& out) const;

  const std::vector<Patch>& patches_;
  const BrickGrid& grid_;
  SmoothWithout without_;
  std::vector<std::uint32_t> form_;  ///< of each patch its number in forms_, or kNone
  std::vector<Form> forms_;
  std::vector<std::uint32_t> face_;
  /// Of the face's patches: places, normals, squares of how far they reach at most; scratch.
  std::array<std::vector<double>, 8> lanes_;
  std::vector<std::uint32_t> near_;  ///< of the face's patches those that may reach a tile
  std::vector<std::uint32_t> here_;  ///< themselves
  std::array<std::uint32_t, kHeads> heads_;
  std::vector<Kept> kept_;
  std::vector<std::uint32_t> lists_;
};

}  // namespace palpate::render
