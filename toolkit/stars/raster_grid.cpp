#include "toolkit/stars/raster_grid.h"

#include <algorithm>

#include "toolkit/neighbourhood/scan_table.h"

namespace palpate::stars {
namespace {

/// A raster with three holes for a point says little of who is next to whom, and its memory would be that of
/// the holes.
constexpr std::uint64_t kMostSlotsPerPoint = 4;

}  // namespace

std::optional<RasterGrid> RasterGrid::of(const cloud::Cloud& cloud) {
  RasterGrid grid;
  if (cloud.raster) {
    const cloud::ScanRaster& raster = *cloud.raster;
    if (std::uint64_t{raster.columns} * raster.rows != cloud.size()) return std::nullopt;
    grid.full_ = raster;
    grid.rows_ = raster.rows;
    grid.columns_ = raster.columns;
    grid.rows_wrap_ = raster.rows_wrap && raster.rows >= neighbourhood::kLeastRound;
    grid.columns_wrap_ = raster.columns_wrap && raster.columns >= neighbourhood::kLeastRound;
  } else if (!grid.read_positions(cloud)) {
    return std::nullopt;
  }
  if (grid.rows_ < 2 || grid.columns_ < 2) return std::nullopt;
  return grid;
}

bool RasterGrid::read_positions(const cloud::Cloud& cloud) {
  const Result<neighbourhood::ScanTable> table = neighbourhood::scan_table_of_properties(cloud);
  if (!table || table->of.empty()) return false;
  neighbourhood::ScanPosition low = table->of.front(), high = low;
  for (const neighbourhood::ScanPosition& at : table->of) {
    if (at.scan != low.scan) return false;
    low.row = std::min(low.row, at.row);
    low.column = std::min(low.column, at.column);
    high.row = std::max(high.row, at.row);
    high.column = std::max(high.column, at.column);
  }
  rows_ = high.row - low.row + 1;
  columns_ = high.column - low.column + 1;
  if (std::uint64_t{rows_} * columns_ > kMostSlotsPerPoint * cloud.size()) return false;
  point_at_.assign(slots(), kNoPlace);
  slot_of_.resize(cloud.size());
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    const neighbourhood::ScanPosition& at = table->of[i];
    const std::uint32_t slot = (at.row - low.row) * columns_ + (at.column - low.column);
    if (point_at_[slot] != kNoPlace) return false;
    point_at_[slot] = i;
    slot_of_[i] = slot;
  }
  return true;
}

}  // namespace palpate::stars
