// Tiles that a surface is cut into, and their packed form.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <set>
#include <span>
#include <vector>

#include "tests/toolkit/spline_sdf/spline_sdf_scenes.h"
#include "toolkit/spline_sdf/brick_tiles.h"

namespace palpate::spline_sdf {
namespace {

std::vector<Brick> bricks_in(const BrickTile& tile, const BrickGrid& grid) {
  std::vector<Brick> bricks;
  for (const std::uint32_t b : tile.bricks) bricks.push_back(grid.bricks[b]);
  return bricks;
}

void expect_unpacked(TileCoder& coder, std::span<const std::byte> image, const BrickTile& tile,
                     const BrickGrid& grid) {
  UnpackedTile out;
  const Status whole = coder.unpack(image, tile.key, grid, out);
  ASSERT_TRUE(whole) << whole.error().what;
  ASSERT_EQ(out.nodes.size(), tile.nodes.size());
  for (std::size_t i = 0; i < out.nodes.size(); ++i) {
    EXPECT_EQ(out.nodes[i].brick, tile.nodes[i].brick);
    EXPECT_EQ(out.nodes[i].children, tile.nodes[i].children);
  }
  ASSERT_EQ(out.bricks.size(), tile.bricks.size());
  for (std::size_t b = 0; b < out.bricks.size(); ++b) {
    const Brick &in = grid.bricks[tile.bricks[b]], &got = out.bricks[b];
    EXPECT_EQ(got.distance, in.distance);
    EXPECT_EQ(got.piece, in.piece);
    EXPECT_EQ(got.mask, in.mask);
  }
}

BrickTile first_tile(const BrickGrid& grid) {
  BrickTile first;
  const auto keep = [&](const BrickTile& tile) -> Status {
    if (first.bricks.empty()) first = tile;
    return Done{};
  };
  EXPECT_TRUE(cut_into_tiles(grid, {keep, [](const PlacedBrick&) -> Status { return Done{}; }}));
  return first;
}

TEST(TileCoder, LosesNothingWhereBricksDoNotAgree) {
  // Every node is its own: nothing is shared, and no prediction helps.
  SplineSdf surface = *surface_of(block_cloud());
  Random random(3);
  for (Brick& brick : surface.grid.bricks)
    for (std::int16_t& distance : brick.distance)
      distance = static_cast<std::int16_t>(std::lround(random.uniform() * 65534.0 - 32767.0));
  const BrickTile tile = first_tile(surface.grid);
  ASSERT_GT(tile.bricks.size(), 8u);
  TileCoder coder;
  for (int again = 0; again < 2; ++again)
    expect_unpacked(coder, coder.pack(tile, bricks_in(tile, surface.grid)).value(), tile, surface.grid);
}

TEST(TileCoder, RefusesWhatIsCutOrChanged) {
  const std::shared_ptr<const SplineSdf> surface = surface_of(block_cloud());
  const BrickTile tile = first_tile(surface->grid);
  TileCoder coder;
  const std::vector<std::byte> image = coder.pack(tile, bricks_in(tile, surface->grid)).value();
  UnpackedTile out;
  for (std::size_t bytes = 0; bytes < image.size(); bytes += 1 + bytes / 16)
    EXPECT_FALSE(coder.unpack(std::span(image).first(bytes), tile.key, surface->grid, out)) << bytes;
  for (std::size_t at = 0; at < kTileHeadBytes; ++at) {
    std::vector<std::byte> changed = image;
    changed[at] ^= std::byte{1};
    EXPECT_FALSE(coder.unpack(changed, tile.key, surface->grid, out)) << at;
  }
  // A tile this deep has no room for its tree.
  EXPECT_FALSE(coder.unpack(image, {0, search::kMortonBits}, surface->grid, out));
  expect_unpacked(coder, image, tile, surface->grid);
}

TEST(BrickTiles, HoldEveryBrickOnce) {
  const std::shared_ptr<const SplineSdf> surface = surface_of(block_cloud());
  std::multiset<std::uint32_t> seen;
  std::uint64_t past = 0, tiles = 0;
  TileCoder coder;
  const auto see_tile = [&](const BrickTile& tile) -> Status {
    ++tiles;
    EXPECT_LE(tile.bricks.size(), kTileBricks);
    EXPECT_GE(tile.key.first_code(), past);
    past = TileKey{tile.key.code + 1, tile.key.depth}.first_code();
    seen.insert(tile.bricks.begin(), tile.bricks.end());
    const std::vector<std::byte> image = coder.pack(tile, bricks_in(tile, surface->grid)).value();
    EXPECT_LT(image.size(), tile.bricks.size() * kStoredBrickBytes / 2) << "nodes are shared";
    expect_unpacked(coder, image, tile, surface->grid);
    return Done{};
  };
  const auto see_above = [&](const PlacedBrick& one) -> Status {
    seen.insert(one.brick);
    return Done{};
  };
  EXPECT_TRUE(cut_into_tiles(surface->grid, {see_tile, see_above}));
  EXPECT_GT(tiles, 3u);
  ASSERT_EQ(seen.size(), surface->grid.bricks.size());
  for (std::uint32_t b = 0; b < seen.size(); ++b) EXPECT_EQ(seen.count(b), 1u) << b;
}

}  // namespace
}  // namespace palpate::spline_sdf
