#include "toolkit/spline_sdf/brick_tiles.h"

#include <algorithm>
#include <utility>

namespace palpate::spline_sdf {
namespace {

class TileCutter {
 public:
  TileCutter(std::span<const PlacedBrick> all, const TileSink& sink) : all_(all), sink_(sink) {}

  Status cut(TileKey node, std::size_t first, std::size_t past) {
    if (first == past) return Done{};
    if (past - first <= kTileBricks) return sink_.tile(tile_of(node, first, past));
    if (all_[first].key.depth == node.depth) PALPATE_TRY(sink_.above(all_[first++]));
    Status cut_so_far = Done{};
    each_child(node, first, past, [&](std::uint64_t, TileKey child, std::size_t a, std::size_t b) {
      if (cut_so_far) cut_so_far = cut(child, a, b);
    });
    return cut_so_far;
  }

 private:
  template <class Visit>
  void each_child(TileKey node, std::size_t first, std::size_t past, Visit&& visit) const {
    for (std::uint64_t k = 0; k < kGroupNodes; ++k) {
      const TileKey child{node.code << 3 | k, node.depth + 1};
      const std::uint64_t next = TileKey{child.code + 1, child.depth}.first_code();
      std::size_t end = first;
      while (end < past && all_[end].key.first_code() < next) ++end;
      visit(k, child, first, end);
      first = end;
    }
  }

  BrickTile tile_of(TileKey node, std::size_t first, std::size_t past) const {
    BrickTile tile;
    tile.key = node;
    tile.nodes.resize(kGroupNodes);
    fill(node, 0, first, past, tile);
    return tile;
  }
  void fill(TileKey node, std::size_t at, std::size_t first, std::size_t past, BrickTile& tile) const {
    if (all_[first].key.depth == node.depth) {
      tile.nodes[at].brick = static_cast<std::uint32_t>(tile.bricks.size());
      tile.bricks.push_back(all_[first].brick);
      ++first;
    }
    if (first == past) return;
    const std::size_t group = tile.nodes.size() / kGroupNodes;
    tile.nodes[at].children = static_cast<std::uint32_t>(group);
    tile.nodes.resize(tile.nodes.size() + kGroupNodes);
    each_child(node, first, past, [&](std::uint64_t k, TileKey child, std::size_t a, std::size_t b) {
      if (a != b) fill(child, group * kGroupNodes + k, a, b, tile);
    });
  }

  std::span<const PlacedBrick> all_;
  const TileSink& sink_;
};

}  // namespace

void sort_placed(std::vector<PlacedBrick>& bricks) {
  std::sort(bricks.begin(), bricks.end(), [](const PlacedBrick& a, const PlacedBrick& b) {
    return std::pair(a.key.first_code(), a.key.depth) < std::pair(b.key.first_code(), b.key.depth);
  });
}

Status cut_into_tiles(TileKey node, std::span<const PlacedBrick> sorted, const TileSink& sink) {
  return TileCutter(sorted, sink).cut(node, 0, sorted.size());
}

Status cut_into_tiles(const BrickGrid& grid, const TileSink& sink) {
  std::vector<PlacedBrick> all;
  all.reserve(grid.bricks.size());
  for (int l = 0; l < grid.levels; ++l) {
    const BrickGrid::Level& level = grid.level[static_cast<std::size_t>(l)];
    const std::vector<std::uint64_t> codes = level.table.codes(level.brick.size());
    for (std::size_t cell = 0; cell < codes.size(); ++cell)
      all.push_back({{codes[cell], depth_of_level(grid, l)}, level.brick[cell] & ~BrickGrid::kRefined});
  }
  sort_placed(all);
  return cut_into_tiles({}, all, sink);
}

BrickSource bricks_of(const BrickGrid& grid) {
  return [&grid](std::uint32_t number, Brick& brick) -> Status {
    brick = grid.bricks[number];
    return Done{};
  };
}

void write_stored_brick(const Brick& brick, ByteWriter& to) noexcept {
  for (const std::int16_t distance : brick.distance) to.u16(static_cast<std::uint16_t>(distance));
  to.u16(brick.piece);
  to.u64(brick.mask);
}

void read_stored_brick(std::span<const std::byte> from, Brick& out) noexcept {
  ByteReader reader(from.first(kStoredBrickBytes));
  for (std::int16_t& distance : out.distance) distance = static_cast<std::int16_t>(reader.u16());
  out.piece = reader.u16();
  out.mask = reader.u64();
}

}  // namespace palpate::spline_sdf
