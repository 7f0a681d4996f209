#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <palpate/aabb.h>
#include "toolkit/core/parallel.h"
#include "toolkit/local_delaunay/raster_cells.h"

namespace palpate::local_delaunay {
namespace {

using geometry::Aabb;

/// Rows and columns of a tile: few, so that boxes of a bent surface are thin; many, so that a million points'
/// tiles take a few milliseconds.
constexpr std::uint32_t kTile = 8;
/// Tiles whose boxes meet are compared by parts: a bent surface fills little of its box.
constexpr std::uint32_t kPart = 2, kParts = (kTile / kPart) * (kTile / kPart);
constexpr std::size_t kTilesAtOnce = 256;
/// A tile is near another within one spacing, but within less than half its short side if rows and columns
/// differ in spacing: the next tile but one is farther.
constexpr double kMaxShortSideShare = 0.5 * kTile;

/// The approximate point distance in a tile.
double spacing_in(const Aabb& tile) noexcept {
  return tile.extent_mm().maxCoeff() / (kTile - 1);
}

/// Boxes of tiles, of 2 x 2 tiles, and so on up to one.
class TileTree {
 public:
  TileTree(const cloud::Cloud& cloud, const RasterGrid& grid, int threads) : cloud_(cloud), grid_(grid) {
    const double down_sq = grid.typical_step_sq(cloud, 1, 0), across_sq = grid.typical_step_sq(cloud, 0, 1);
    const double longer_sq = std::max(down_sq, across_sq);
    if (longer_sq > 0.0) {
      const double share = kMaxShortSideShare * std::sqrt(std::min(down_sq, across_sq) / longer_sq);
      near_share_ = std::min(1.0, share);
    }
    Level tiles((grid.rows() + kTile - 1) / kTile, (grid.columns() + kTile - 1) / kTile);
    parallel_chunks(tiles.rows, 1, threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t row = begin; row < end; ++row)
        for (std::uint32_t column = 0; column < tiles.columns; ++column)
          tiles.at(static_cast<std::uint32_t>(row), column) = box_of(static_cast<std::uint32_t>(row), column);
    });
    levels_.push_back(std::move(tiles));
    while (levels_.back().box.size() > 1) levels_.push_back(above(levels_.back()));
  }
  [[nodiscard]] std::uint32_t rows() const noexcept { return levels_.front().rows; }
  [[nodiscard]] std::uint32_t columns() const noexcept { return levels_.front().columns; }

  /// True if the tile is near a non-adjacent one.
  [[nodiscard]] bool is_overlapped(std::uint32_t row, std::uint32_t column) const {
    const Aabb& own = levels_.front().at(row, column);
    const double near_mm = near_share_ * spacing_in(own);
    const Aabb query = own.grown(near_mm);
    struct Node {
      std::size_t level;
      std::uint32_t row, column;
    };
    std::vector<Node> open = {{levels_.size() - 1, 0, 0}};
    while (!open.empty()) {
      const Node node = open.back();
      open.pop_back();
      if (!levels_[node.level].at(node.row, node.column).overlaps(query)) continue;
      if (node.level == 0) {
        const bool next = is_next(row, node.row, rows(), grid_.rows_wrap()) &&
                          is_next(column, node.column, columns(), grid_.columns_wrap());
        if (!next && are_near(parts_of(row, column), parts_of(node.row, node.column), near_mm)) return true;
        continue;
      }
      const Level& below = levels_[node.level - 1];
      for (std::uint32_t r = 2 * node.row; r < std::min(2 * node.row + 2, below.rows); ++r)
        for (std::uint32_t c = 2 * node.column; c < std::min(2 * node.column + 2, below.columns); ++c)
          open.push_back({node.level - 1, r, c});
    }
    return false;
  }

 private:
  struct Level {
    std::uint32_t rows, columns;
    std::vector<Aabb> box;
    Level(std::uint32_t r, std::uint32_t c) : rows(r), columns(c), box(std::size_t{r} * c) {}
    [[nodiscard]] Aabb& at(std::uint32_t row, std::uint32_t column) noexcept {
      return box[std::size_t{row} * columns + column];
    }
    [[nodiscard]] const Aabb& at(std::uint32_t row, std::uint32_t column) const noexcept {
      return box[std::size_t{row} * columns + column];
    }
  };

  using Parts = std::array<Aabb, kParts>;

  /// Empty without points or past the raster's end.
  [[nodiscard]] Parts parts_of(std::uint32_t tile_row, std::uint32_t tile_column) const noexcept {
    Parts parts;
    const std::uint32_t first_row = tile_row * kTile, first_column = tile_column * kTile;
    const std::uint32_t last_row = std::min(first_row + kTile, grid_.rows());
    const std::uint32_t last_column = std::min(first_column + kTile, grid_.columns());
    for (std::uint32_t row = first_row; row < last_row; ++row)
      for (std::uint32_t column = first_column; column < last_column; ++column) {
        const std::uint32_t i = grid_.point(row, column);
        if (i == kNoPlace) continue;
        const std::uint32_t part =
            (row - first_row) / kPart * (kTile / kPart) + (column - first_column) / kPart;
        parts[part].add(cloud_.local_mm(i));
      }
    return parts;
  }
  [[nodiscard]] Aabb box_of(std::uint32_t tile_row, std::uint32_t tile_column) const noexcept {
    Aabb box;
    for (const Aabb& part : parts_of(tile_row, tile_column)) box.add(part);
    return box;
  }
  static bool are_near(const Parts& one, const Parts& other, double near_mm) noexcept {
    for (const Aabb& part : one) {
      const Aabb query = part.grown(near_mm);
      for (const Aabb& there : other)
        if (there.overlaps(query)) return true;
    }
    return false;
  }
  static Level above(const Level& below) {
    Level level((below.rows + 1) / 2, (below.columns + 1) / 2);
    for (std::uint32_t row = 0; row < below.rows; ++row)
      for (std::uint32_t column = 0; column < below.columns; ++column)
        level.at(row / 2, column / 2).add(below.at(row, column));
    return level;
  }
  /// Where a turn ends the last tile may be one row wide, so the last but one is adjacent too.
  static bool is_next(std::uint32_t one, std::uint32_t other, std::uint32_t count, bool wraps) noexcept {
    const std::uint32_t apart = std::max(one, other) - std::min(one, other);
    return apart <= 1 || (wraps && count - apart <= 2);
  }

  const cloud::Cloud& cloud_;
  const RasterGrid& grid_;
  double near_share_ = 1.0;    ///< of a tile's longer spacing
  std::vector<Level> levels_;  ///< level 0: tiles; the last level has one box
};

}  // namespace

void mark_overlaps(const cloud::Cloud& cloud, const RasterGrid& grid, int threads,
                   std::vector<std::uint8_t>& doubtful) {
  const TileTree tree(cloud, grid, threads);
  const std::uint32_t columns = tree.columns();
  const std::size_t tiles = std::size_t{tree.rows()} * columns;
  parallel_chunks(tiles, kTilesAtOnce, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t tile = begin; tile < end; ++tile) {
      const auto tile_row = static_cast<std::uint32_t>(tile / columns);
      const auto tile_column = static_cast<std::uint32_t>(tile % columns);
      if (!tree.is_overlapped(tile_row, tile_column)) continue;
      const std::uint32_t last_row = std::min((tile_row + 1) * kTile, grid.rows());
      const std::uint32_t last_column = std::min((tile_column + 1) * kTile, grid.columns());
      for (std::uint32_t row = tile_row * kTile; row < last_row; ++row)
        for (std::uint32_t column = tile_column * kTile; column < last_column; ++column)
          if (grid.point(row, column) != kNoPlace) doubtful[std::size_t{row} * grid.columns() + column] = 1;
    }
  });
}

}  // namespace palpate::local_delaunay
