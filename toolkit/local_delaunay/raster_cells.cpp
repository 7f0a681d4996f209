#include "toolkit/local_delaunay/raster_cells.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include <palpate/geometry.h>
#include "toolkit/core/parallel.h"
#include "toolkit/core/statistics.h"
#include "toolkit/geometry/broad_phase.h"
#include "toolkit/search/knn.h"

namespace palpate::local_delaunay {

namespace {

/// Largest ratio of positions to points. A scanner's raster exceeds what it saw: five to six of seven
/// positions are empty in the bunny's range scans. Beyond this its memory, 25 bytes a position, would go to
/// holes.
constexpr std::uint64_t kMaxSlotsPerPoint = 8;
/// Sampled steps that estimate row and column distances.
constexpr std::size_t kSampledSteps = 255;

}  // namespace

std::optional<RasterGrid> RasterGrid::of(const cloud::Cloud& cloud) {
  RasterGrid grid;
  if (cloud.raster) {
    const cloud::ScanRaster& raster = *cloud.raster;
    if (std::uint64_t{raster.columns} * raster.rows != cloud.size()) return std::nullopt;
    grid.full_ = raster;
    grid.rows_ = raster.rows;
    grid.columns_ = raster.columns;
    grid.rows_wrap_ = raster.rows_wrap && raster.rows >= search::kMinWrapCount;
    grid.columns_wrap_ = raster.columns_wrap && raster.columns >= search::kMinWrapCount;
  } else if (!grid.read_positions(cloud)) {
    return std::nullopt;
  }
  if (grid.rows_ < 2 || grid.columns_ < 2) return std::nullopt;
  return grid;
}

bool RasterGrid::read_positions(const cloud::Cloud& cloud) {
  const Result<search::ScanTable> table = search::scan_table_of_properties(cloud);
  if (!table || table->of.empty()) return false;
  search::ScanPosition low = table->of.front(), high = low;
  for (const search::ScanPosition& at : table->of) {
    if (at.scan != low.scan) return false;
    low.row = std::min(low.row, at.row);
    low.column = std::min(low.column, at.column);
    high.row = std::max(high.row, at.row);
    high.column = std::max(high.column, at.column);
  }
  rows_ = high.row - low.row + 1;
  columns_ = high.column - low.column + 1;
  if (std::uint64_t{rows_} * columns_ > kMaxSlotsPerPoint * cloud.size()) return false;
  point_at_.assign(slots(), kNoPlace);
  slot_of_.resize(cloud.size());
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    const search::ScanPosition& at = table->of[i];
    const std::uint32_t slot = (at.row - low.row) * columns_ + (at.column - low.column);
    if (point_at_[slot] != kNoPlace) return false;
    point_at_[slot] = i;
    slot_of_[i] = slot;
  }
  return true;
}

double RasterGrid::typical_step_sq(const cloud::Cloud& cloud, int down, int across) const {
  std::vector<double> squares;
  for (std::size_t k = 0; k < kSampledSteps; ++k) {
    const std::size_t slot = (2 * k + 1) * slots() / (2 * kSampledSteps);
    const auto row = static_cast<std::uint32_t>(slot / columns_);
    const auto column = static_cast<std::uint32_t>(slot % columns_);
    const std::uint32_t to_row = down == 0 ? row : row_beside(row, 1);
    const std::uint32_t to_column = across == 0 ? column : column_beside(column, 1);
    if (to_row == kNoPlace || to_column == kNoPlace) continue;
    const std::uint32_t one = point(row, column), other = point(to_row, to_column);
    if (one == kNoPlace || other == kNoPlace) continue;
    squares.push_back((cloud.local_mm(other) - cloud.local_mm(one)).squaredNorm());
  }
  return squares.empty() ? 0.0 : upper_median(std::move(squares));
}

namespace {

/// An edge over twice as long as the next in its row or column, or as the opposite one of the cell, is a
/// jump. Between two sheets seen straight on it turns by over 60 degrees, like a fold.
constexpr double kMaxStretchSq = 4.0;
/// Planes turned by more than 60 degrees from the local mean are folded.
constexpr double kMinCosineSq = 0.25;
/// Largest squared ratio of row to column distance: allows scan lines of 8:1 with reliable facet directions.
constexpr double kMaxAspectSq = 256.0;
/// Largest angle of a triangle's corner, 120 degrees, as squared double cosine. Beyond it Delaunay stars
/// differ, and are better where a raster is steep in both directions.
constexpr double kWideCornerSq = 1.0;
constexpr std::size_t kSlotsPerChunk = 16384;

/// `one` and `other` are squared lengths.
bool jumps(double one, double other) noexcept {
  return std::max(one, other) > kMaxStretchSq * std::min(one, other);
}
bool turns(const Vec3& one, const Vec3& mean) noexcept {
  const double along = one.dot(mean);
  return !(along > 0.0 && along * along >= kMinCosineSq * one.squaredNorm() * mean.squaredNorm());
}
/// Takes squared lengths. True for a corner of 120 degrees or sides much longer than others.
bool is_poor(double a, double b, double c) noexcept {
  const double longest = std::max({a, b, c}), shortest = std::min({a, b, c});
  const double middle = a + b + c - longest - shortest;
  const double beyond = longest - shortest - middle;
  if (beyond > 0.0 && beyond * beyond > kWideCornerSq * shortest * middle) return true;
  return !(shortest > 0.0 && longest <= kMaxAspectSq * shortest);
}

/// A cell with three corners; `middle` is opposite the missing one.
RasterCell half_cell(const Vec3& middle, const Vec3& next, const Vec3& last, std::uint32_t form) noexcept {
  RasterCell cell;
  const Vec3 a = next - middle, b = last - middle;
  cell.area = a.cross(b).cast<float>();
  cell.form = form;
  if (is_poor(a.squaredNorm(), b.squaredNorm(), (b - a).squaredNorm())) cell.form |= RasterCell::kDoubtful;
  return cell;
}

}  // namespace

RasterCell raster_cell(const std::array<const Vec3*, 4>& at) noexcept {
  constexpr std::uint32_t kDown = RasterCell::kDown, kFirst = RasterCell::kFirst,
                          kSecond = RasterCell::kSecond;
  const auto& [a, b, c, d] = at;  // 00, 01, 10, 11
  const int present = (a != nullptr) + (b != nullptr) + (c != nullptr) + (d != nullptr);
  if (present < 3) return {};
  if (d == nullptr) return half_cell(*a, *b, *c, kFirst);
  if (a == nullptr) return half_cell(*d, *c, *b, kSecond);
  if (c == nullptr) return half_cell(*b, *d, *a, kDown | kFirst);
  if (b == nullptr) return half_cell(*c, *a, *d, kDown | kSecond);
  const Vec3 above = *b - *a, left = *c - *a, below = *d - *c, right = *d - *b;
  const Vec3 down = *d - *a, up = *b - *c;
  const double above_sq = above.squaredNorm(), left_sq = left.squaredNorm(), below_sq = below.squaredNorm(),
               right_sq = right.squaredNorm(), down_sq = down.squaredNorm(), up_sq = up.squaredNorm();
  const bool is_down = down_sq <= up_sq;
  const Vec3 first = is_down ? above.cross(down) : above.cross(left);
  const Vec3 second = is_down ? down.cross(left) : below.cross(right);
  const Vec3 area = first + second;
  RasterCell cell;
  cell.area = area.cast<float>();
  cell.form = (is_down ? kDown : 0u) | kFirst | kSecond;
  const bool poor = is_down ? is_poor(above_sq, right_sq, down_sq) || is_poor(below_sq, left_sq, down_sq)
                            : is_poor(above_sq, left_sq, up_sq) || is_poor(below_sq, right_sq, up_sq);
  if (poor || turns(first, area) || turns(second, area) || jumps(above_sq, below_sq) ||
      jumps(left_sq, right_sq))
    cell.form |= RasterCell::kDoubtful;
  return cell;
}

namespace {

class CellMaker {
 public:
  CellMaker(const cloud::Cloud& cloud, const RasterGrid& grid) : cloud_(cloud), grid_(grid) {
    cells_.cell.resize(grid.slots());
    cells_.doubtful.assign(grid.slots(), 0);
  }
  RasterCells run(int threads) {
    const std::size_t rows = std::max<std::size_t>(1, kSlotsPerChunk / grid_.columns());
    parallel_each(grid_.rows(), rows, threads,
                  [&](std::size_t row) { make_row(static_cast<std::uint32_t>(row)); });
    parallel_each(grid_.rows(), rows, threads,
                  [&](std::size_t row) { judge_row(static_cast<std::uint32_t>(row)); });
    return std::move(cells_);
  }

 private:
  struct Corner {
    Vec3 at;
    bool is_there = false;
    [[nodiscard]] const Vec3* get() const noexcept { return is_there ? &at : nullptr; }
  };
  [[nodiscard]] Corner corner(std::uint32_t row, std::uint32_t column) const noexcept {
    const std::uint32_t i = grid_.point(row, column);
    return i == kNoPlace ? Corner{Vec3::Zero(), false} : Corner{cloud_.local_mm(i), true};
  }
  [[nodiscard]] std::size_t slot(std::uint32_t row, std::uint32_t column) const noexcept {
    return std::size_t{row} * grid_.columns() + column;
  }
  void make_row(std::uint32_t row) noexcept {
    const std::uint32_t below = grid_.row_beside(row, 1);
    if (below == kNoPlace) return;
    Corner a = corner(row, 0), c = corner(below, 0);
    for (std::uint32_t column = 0; column < grid_.columns(); ++column) {
      const std::uint32_t beside = grid_.column_beside(column, 1);
      if (beside == kNoPlace) return;
      const Corner b = corner(row, beside), d = corner(below, beside);
      cells_.cell[slot(row, column)] = raster_cell({a.get(), b.get(), c.get(), d.get()});
      a = b;
      c = d;
    }
  }
  /// True if one of the edges to both neighbours is a jump.
  [[nodiscard]] static bool jump_at(const Corner& here, const Corner& before, const Corner& behind) noexcept {
    return before.is_there && behind.is_there &&
           jumps((before.at - here.at).squaredNorm(), (behind.at - here.at).squaredNorm());
  }
  void judge_row(std::uint32_t row) noexcept {
    const std::uint32_t above = grid_.row_beside(row, -1), below = grid_.row_beside(row, 1);
    const RasterCell none;
    const auto cell = [&](std::uint32_t r, std::uint32_t c) -> const RasterCell& {
      return r == kNoPlace || c == kNoPlace ? none : cells_.at(grid_, r, c);
    };
    const auto at = [&](std::uint32_t r, std::uint32_t c) {
      return r == kNoPlace || c == kNoPlace ? Corner{Vec3::Zero(), false} : corner(r, c);
    };
    Corner left = at(row, grid_.column_beside(0, -1)), here = corner(row, 0);
    for (std::uint32_t column = 0; column < grid_.columns(); ++column) {
      const std::uint32_t before = grid_.column_beside(column, -1), beside = grid_.column_beside(column, 1);
      const Corner right = at(row, beside);
      if (here.is_there) {
        const std::array<const RasterCell*, 4> around = {&cell(row, column), &cell(row, before),
                                                         &cell(above, before), &cell(above, column)};
        bool doubtful = (around[0]->form | around[1]->form | around[2]->form | around[3]->form) == 0;
        Vec3 mean = Vec3::Zero();
        for (const RasterCell* of : around) {
          doubtful = doubtful || of->has(RasterCell::kDoubtful);
          mean += of->area.cast<double>();
        }
        for (const RasterCell* of : around)
          doubtful = doubtful || (of->form != 0 && turns(of->area.cast<double>(), mean));
        doubtful =
            doubtful || jump_at(here, left, right) || jump_at(here, at(above, column), at(below, column));
        cells_.doubtful[slot(row, column)] = static_cast<std::uint8_t>(doubtful);
      }
      left = here;
      here = right;
    }
  }

  const cloud::Cloud& cloud_;
  const RasterGrid& grid_;
  RasterCells cells_;
};

}  // namespace

RasterCells cells_of(const cloud::Cloud& cloud, const RasterGrid& grid, int threads) {
  return CellMaker(cloud, grid).run(threads);
}

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

/// The raster cut into tiles, with their boxes.
class Tiles {
 public:
  Tiles(const cloud::Cloud& cloud, const RasterGrid& grid, int threads)
      : cloud_(cloud),
        grid_(grid),
        rows_((grid.rows() + kTile - 1) / kTile),
        columns_((grid.columns() + kTile - 1) / kTile),
        box_(std::size_t{rows_} * columns_) {
    const double down_sq = grid.typical_step_sq(cloud, 1, 0), across_sq = grid.typical_step_sq(cloud, 0, 1);
    const double longer_sq = std::max(down_sq, across_sq);
    if (longer_sq > 0.0) {
      const double share = kMaxShortSideShare * std::sqrt(std::min(down_sq, across_sq) / longer_sq);
      near_share_ = std::min(1.0, share);
    }
    parallel_each<std::uint32_t>(box_.size(), columns_, threads, [&](std::uint32_t tile) {
      for (const Aabb& part : parts_of(tile)) box_[tile].add(part);
    });
    tree_ = geometry::AabbTree(count(), [this](std::uint32_t tile) { return box_[tile]; });
  }
  [[nodiscard]] std::uint32_t count() const noexcept { return static_cast<std::uint32_t>(box_.size()); }

  /// True if the tile is near a non-adjacent one.
  [[nodiscard]] bool is_overlapped(std::uint32_t tile) const {
    const double near_mm = near_share_ * spacing_in(box_[tile]);
    const Aabb query = box_[tile].grown(near_mm);
    const Parts own = parts_of(tile);
    bool found = false;
    tree_.visit([&](const Aabb& box) { return !found && box.overlaps(query); },
                [&](std::uint32_t other) {
                  const bool next =
                      is_next(tile / columns_, other / columns_, rows_, grid_.rows_wrap()) &&
                      is_next(tile % columns_, other % columns_, columns_, grid_.columns_wrap());
                  found = found || (!next && are_near(own, parts_of(other), near_mm));
                });
    return found;
  }

  /// Calls visit(slot, point) for the tile's points.
  template <class Visit>
  void visit(std::uint32_t tile, const Visit& visit) const {
    const std::uint32_t first_row = tile / columns_ * kTile, first_column = tile % columns_ * kTile;
    const std::uint32_t last_row = std::min(first_row + kTile, grid_.rows());
    const std::uint32_t last_column = std::min(first_column + kTile, grid_.columns());
    for (std::uint32_t row = first_row; row < last_row; ++row)
      for (std::uint32_t column = first_column; column < last_column; ++column)
        if (const std::uint32_t i = grid_.point(row, column); i != kNoPlace)
          visit(std::size_t{row} * grid_.columns() + column, i);
  }

 private:
  using Parts = std::array<Aabb, kParts>;

  /// Empty without points or past the raster's end.
  [[nodiscard]] Parts parts_of(std::uint32_t tile) const noexcept {
    Parts parts;
    visit(tile, [&](std::size_t slot, std::uint32_t point) {
      const std::size_t row = slot / grid_.columns() % kTile, column = slot % grid_.columns() % kTile;
      parts[row / kPart * (kTile / kPart) + column / kPart].add(cloud_.local_mm(point));
    });
    return parts;
  }
  static bool are_near(const Parts& one, const Parts& other, double near_mm) noexcept {
    for (const Aabb& part : one) {
      const Aabb query = part.grown(near_mm);
      for (const Aabb& there : other)
        if (there.overlaps(query)) return true;
    }
    return false;
  }
  /// Where a turn ends the last tile may be one row wide, so the last but one is adjacent too.
  static bool is_next(std::uint32_t one, std::uint32_t other, std::uint32_t count, bool wraps) noexcept {
    const std::uint32_t apart = std::max(one, other) - std::min(one, other);
    return apart <= 1 || (wraps && count - apart <= 2);
  }

  const cloud::Cloud& cloud_;
  const RasterGrid& grid_;
  double near_share_ = 1.0;  ///< of a tile's longer spacing
  std::uint32_t rows_, columns_;
  std::vector<Aabb> box_;
  geometry::AabbTree tree_;
};

}  // namespace

void mark_overlaps(const cloud::Cloud& cloud, const RasterGrid& grid, int threads,
                   std::vector<std::uint8_t>& doubtful) {
  const Tiles tiles(cloud, grid, threads);
  parallel_each<std::uint32_t>(tiles.count(), kTilesAtOnce, threads, [&](std::uint32_t tile) {
    if (tiles.is_overlapped(tile))
      tiles.visit(tile, [&](std::size_t slot, std::uint32_t) { doubtful[slot] = 1; });
  });
}

}  // namespace palpate::local_delaunay
