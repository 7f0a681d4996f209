#include <algorithm>
#include <array>

#include "toolkit/core/parallel.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/knn_engine.h"
#include "toolkit/search/scan_table.h"

namespace palpate::search {
namespace {

constexpr std::size_t kRowsPerChunk = 64;

/// A row (or column) with those on both sides.
struct Range {
  std::array<std::size_t, 3> at{};
  std::size_t count = 0;
};

Range around(std::size_t i, std::size_t size, bool wrap) noexcept {
  const bool round = wrap && size >= kMinWrapCount;
  Range range;
  if (i > 0 || round) range.at[range.count++] = i > 0 ? i - 1 : size - 1;
  range.at[range.count++] = i;
  if (i + 1 < size || round) range.at[range.count++] = i + 1 < size ? i + 1 : 0;
  return range;
}

}  // namespace

Result<NeighbourTable> scanner_path(const cloud::Cloud& cloud, int threads) {
  if (!cloud.raster)
    return Error{"the cloud is not a full raster, so the scanner's path gives no neighbours",
                 "choose neighbours=modified-knn or neighbours=exact-knn",
                 {},
                 0};
  return scanner_path(cloud, *cloud.raster, threads);
}

Result<NeighbourTable> scanner_path(const cloud::Cloud& cloud, const cloud::ScanRaster& raster, int threads) {
  if (std::uint64_t{raster.columns} * raster.rows != cloud.size())
    return Error{"the cloud's raster does not match its number of points", "rebuild the cloud", {}, 0};
  NeighbourTable table;
  table.of.resize(cloud.size());
  parallel_chunks(raster.rows, kRowsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) {
      const Range rows = around(row, raster.rows, raster.rows_wrap);
      for (std::size_t column = 0; column < raster.columns; ++column) {
        const Range columns = around(column, raster.columns, raster.columns_wrap);
        const std::size_t self = raster.index(row, column);
        const Vec3 p = cloud.local_mm(self);
        NearestEight best;
        for (std::size_t r = 0; r < rows.count; ++r)
          for (std::size_t c = 0; c < columns.count; ++c) {
            const std::size_t other = raster.index(rows.at[r], columns.at[c]);
            if (other != self)
              best.offer((cloud.local_mm(other) - p).squaredNorm(), static_cast<std::uint32_t>(other));
          }
        best.store(static_cast<std::uint32_t>(self), table.of[self]);
      }
    }
  });
  return table;
}

Agreement agreement(const NeighbourTable& a, const NeighbourTable& b) {
  Agreement sum;
  const std::size_t n = std::min(a.size(), b.size());
  const std::size_t chunks = (n + kPointsPerChunk - 1) / kPointsPerChunk;
  std::vector<Agreement> parts(chunks);
  parallel_chunks(n, kPointsPerChunk, 0, [&](std::size_t begin, std::size_t end) {
    Agreement& part = parts[begin / kPointsPerChunk];
    for (std::size_t i = begin; i < end; ++i) {
      Neighbours x = a.of[i], y = b.of[i];
      std::sort(x.begin(), x.end());
      std::sort(y.begin(), y.end());
      const bool equal = x == y;
      const bool interior = a.count(i) == kNeighbours && b.count(i) == kNeighbours;
      ++part.points;
      part.equal_sets += equal;
      part.interior_points += interior;
      part.interior_equal += interior && equal;
    }
  });
  for (const Agreement& part : parts) {
    sum.points += part.points;
    sum.equal_sets += part.equal_sets;
    sum.interior_points += part.interior_points;
    sum.interior_equal += part.interior_equal;
  }
  return sum;
}

}  // namespace palpate::search
