#include <algorithm>

#include "toolkit/core/parallel.h"
#include "toolkit/neighbourhood/knn.h"
#include "toolkit/neighbourhood/knn_engine.h"

namespace palpate::neighbourhood {
namespace {

constexpr std::size_t kRowsPerChunk = 64;
constexpr std::size_t kPointsPerChunk = 65536;

}  // namespace

Result<NeighbourTable> scanner_path(const cloud::Cloud& cloud, int threads) {
  if (!cloud.raster)
    return Error{"the cloud is not a full raster, so the scanner's path gives no neighbours",
                 "choose neighbours=modified-knn or neighbours=exact-knn",
                 {},
                 0};
  const auto columns = static_cast<std::int64_t>(cloud.raster->columns);
  const auto rows = static_cast<std::int64_t>(cloud.raster->rows);
  if (columns * rows != static_cast<std::int64_t>(cloud.size()))
    return Error{"the cloud's raster does not match its number of points", "rebuild the cloud", {}, 0};
  NeighbourTable table;
  table.of.resize(cloud.size());
  parallel_chunks(
      static_cast<std::size_t>(rows), kRowsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
        for (auto row = static_cast<std::int64_t>(begin); row < static_cast<std::int64_t>(end); ++row)
          for (std::int64_t column = 0; column < columns; ++column) {
            const auto self = static_cast<std::uint32_t>(row * columns + column);
            const Vec3 p = cloud.local_mm(self);
            BestEight around;
            for (std::int64_t r = std::max<std::int64_t>(row - 1, 0); r <= std::min(row + 1, rows - 1); ++r)
              for (std::int64_t c = std::max<std::int64_t>(column - 1, 0);
                   c <= std::min(column + 1, columns - 1); ++c) {
                const auto other = static_cast<std::uint32_t>(r * columns + c);
                if (other != self) around.offer((cloud.local_mm(other) - p).squaredNorm(), other);
              }
            around.store(self, table.of[self]);
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

}  // namespace palpate::neighbourhood
