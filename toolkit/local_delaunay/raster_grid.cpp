#include "toolkit/local_delaunay/raster_grid.h"

#include <algorithm>
#include <utility>

#include "toolkit/core/percentiles.h"
#include "toolkit/search/scan_table.h"

namespace palpate::local_delaunay {
namespace {

/// Largest ratio of positions to points. A scanner's raster exceeds what it saw: five to six of seven
/// positions are empty in the bunny's range scans. Beyond this its memory, 25 bytes a position, would go to
/// holes.
constexpr std::uint64_t kMaxSlotsPerPoint = 8;
/// Sampled steps that estimate row and column distances.
constexpr std::size_t kStepsLookedAt = 255;

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
  for (std::size_t k = 0; k < kStepsLookedAt; ++k) {
    const std::size_t slot = (2 * k + 1) * slots() / (2 * kStepsLookedAt);
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

}  // namespace palpate::local_delaunay
