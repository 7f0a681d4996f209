#include "toolkit/search/knn.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include <palpate/result.h>
#include "toolkit/core/hash.h"
#include "toolkit/core/parallel.h"
#include "toolkit/search/knn_kernels.h"

namespace palpate::search {
namespace {

/// Integers up to here are exact in a float.
constexpr float kLargestWhole = 16777216.0F;
constexpr std::uint32_t kNoPoint = ~0u;

/// Row and column steps of figure 39's directions.
constexpr std::array<std::array<int, 2>, kNeighbours> kScanDirections = {
    {{-1, -1}, {-1, 0}, {-1, 1}, {0, -1}, {0, 1}, {1, -1}, {1, 0}, {1, 1}}};

/// Hash from position to point; open addressing, so hostile rows at 2^32 cost no more.
class Positions {
 public:
  explicit Positions(const std::vector<ScanPosition>& of)
      : of_(of), slots_(std::bit_ceil(std::max<std::size_t>(2 * of.size(), 2)), kNoPoint) {}

  /// Returns the point that was there before, or kNoPoint.
  std::uint32_t put(std::uint32_t point) noexcept {
    std::size_t at = slot(of_[point]);
    for (; slots_[at] != kNoPoint; at = (at + 1) & (slots_.size() - 1))
      if (of_[slots_[at]] == of_[point]) return slots_[at];
    slots_[at] = point;
    return kNoPoint;
  }
  [[nodiscard]] std::uint32_t find(const ScanPosition& position) const noexcept {
    for (std::size_t at = slot(position); slots_[at] != kNoPoint; at = (at + 1) & (slots_.size() - 1))
      if (of_[slots_[at]] == position) return slots_[at];
    return kNoPoint;
  }

 private:
  /// Eight columns of a row are adjacent, so looks to the sides mostly hit one cache line; longer runs would
  /// collide.
  [[nodiscard]] std::size_t slot(const ScanPosition& p) const noexcept {
    std::uint64_t line = (std::uint64_t{p.scan} << 32 | p.row) * kGolden64;
    line = ((line ^ line >> 32) + p.column / kRun) * kGolden64;
    return static_cast<std::size_t>((line >> 32) * kRun + p.column % kRun) & (slots_.size() - 1);
  }
  static constexpr std::uint32_t kRun = 8;
  const std::vector<ScanPosition>& of_;
  std::vector<std::uint32_t> slots_;
};

/// The coordinate `step` away, or kNoPoint outside.
std::uint32_t stepped(std::uint32_t from, std::int64_t step, std::uint32_t round) noexcept {
  std::int64_t to = std::int64_t{from} + step;
  if (round >= kMinWrapCount) to = (to % round + round) % round;
  return to < 0 || to >= std::int64_t{kNoPoint} ? kNoPoint : static_cast<std::uint32_t>(to);
}

/// The first point in that direction, at most `gaps` positions beyond the next; else kNoPoint.
std::uint32_t next_in_direction(const ScanTable& table, const Positions& positions, std::uint32_t self,
                                const std::array<int, 2>& step, std::uint32_t across,
                                std::uint32_t& gaps) noexcept {
  const ScanPosition& here = table.of[self];
  for (gaps = 0; gaps <= across; ++gaps) {
    const std::int64_t far = std::int64_t{gaps} + 1;
    const ScanPosition there = {here.scan, stepped(here.row, far * step[0], table.rows_wrap),
                                stepped(here.column, far * step[1], table.columns_wrap)};
    if (there.row == kNoPoint || there.column == kNoPoint || there == here) return kNoPoint;
    if (const std::uint32_t found = positions.find(there); found != kNoPoint) return found;
  }
  return kNoPoint;
}

const cloud::Property* property_of(const cloud::Cloud& cloud, std::string_view name) {
  for (const cloud::Property& property : cloud.properties)
    if (property.name == name) return &property;
  return nullptr;
}

Result<std::uint32_t> whole(const cloud::Property& property, std::size_t point) {
  const float value = property.values[point];
  if (!(value >= 0.0F) || value > kLargestWhole || value != std::floor(value))
    return Error{fmt::format("point {} has {} = {}, which is no place in a scan", point + 1, property.name,
                             static_cast<double>(value)),
                 "give whole numbers from 0 to 16777216"};
  return static_cast<std::uint32_t>(value);
}

}  // namespace

Result<ScanTable> scan_table_of_raster(const cloud::Cloud& cloud) {
  if (!cloud.raster) return Error{"the cloud is not a full raster", "give the properties row and column"};
  const cloud::ScanRaster& raster = *cloud.raster;
  if (std::uint64_t{raster.columns} * raster.rows != cloud.size())
    return Error{"the cloud's raster does not match its number of points", "rebuild the cloud"};
  ScanTable table;
  table.columns_wrap = raster.columns_wrap ? raster.columns : 0;
  table.rows_wrap = raster.rows_wrap ? raster.rows : 0;
  table.of.resize(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i)
    table.of[i] = {0, static_cast<std::uint32_t>(i / raster.columns),
                   static_cast<std::uint32_t>(raster.column(i))};
  return table;
}

Result<ScanTable> scan_table_of_properties(const cloud::Cloud& cloud) {
  const cloud::Property* const row = property_of(cloud, "row");
  const cloud::Property* const column = property_of(cloud, "column");
  const cloud::Property* const scan = property_of(cloud, "scan");
  if (row == nullptr || column == nullptr)
    return Error{"the cloud does not say where in a scan its points were taken",
                 "give a file with the properties row and column, or choose neighbours=modified-knn"};
  ScanTable table;
  table.of.resize(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    PALPATE_ASSIGN(const std::uint32_t r, whole(*row, i));
    PALPATE_ASSIGN(const std::uint32_t c, whole(*column, i));
    PALPATE_ASSIGN(const std::uint32_t s, scan == nullptr ? Result<std::uint32_t>(0u) : whole(*scan, i));
    table.of[i] = {s, r, c};
  }
  return table;
}

Result<ScanTable> scan_table_of(const cloud::Cloud& cloud) {
  return cloud.raster ? scan_table_of_raster(cloud) : scan_table_of_properties(cloud);
}

Result<NeighbourTable> lookup_table(const cloud::Cloud& cloud, const ScanTable& table,
                                    const LookupOptions& options, int threads, LookupReport* report) {
  const std::size_t n = cloud.size();
  if (table.of.size() != n)
    return Error{fmt::format("the look-up table has {} positions for {} points", table.of.size(), n)};
  Positions positions(table.of);
  for (std::uint32_t i = 0; i < n; ++i)
    if (const std::uint32_t other = positions.put(i); other != kNoPoint)
      return Error{fmt::format("points {} and {} were both taken in scan {}, row {}, column {}", other + 1,
                               i + 1, table.of[i].scan, table.of[i].row, table.of[i].column),
                   "number the scans in a property 'scan'"};
  NeighbourTable neighbours;
  neighbours.of.resize(n);
  const auto link = [&](std::size_t i, LookupReport& part) {
    const auto self = static_cast<std::uint32_t>(i);
    const Vec3 p = cloud.local_mm(self);
    Neighbours seen;
    std::size_t count = 0;
    NearestEight around;
    for (const auto& step : kScanDirections) {
      std::uint32_t gaps = 0;
      const std::uint32_t other = next_in_direction(table, positions, self, step, options.across, gaps);
      // On a small turntable one point may lie in both directions.
      if (other == kNoPoint || other == self ||
          std::find(seen.begin(), seen.begin() + count, other) != seen.begin() + count)
        continue;
      seen[count++] = other;
      part.links_across_holes += gaps > 0;
      around.offer((cloud.local_mm(other) - p).squaredNorm(), other);
    }
    part.fewer_than_eight += count < kNeighbours;
    around.store(self, neighbours.of[self]);
  };
  LookupReport sum;
  for (const auto& part : parallel_parts<LookupReport>(n, kPointsPerChunk, threads, link)) {
    sum.links_across_holes += part.links_across_holes;
    sum.fewer_than_eight += part.fewer_than_eight;
  }
  if (report != nullptr) *report = sum;
  return neighbours;
}

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
                 "choose neighbours=modified-knn or neighbours=exact-knn"};
  return scanner_path(cloud, *cloud.raster, threads);
}

Result<NeighbourTable> scanner_path(const cloud::Cloud& cloud, const cloud::ScanRaster& raster, int threads) {
  if (std::uint64_t{raster.columns} * raster.rows != cloud.size())
    return Error{"the cloud's raster does not match its number of points", "rebuild the cloud"};
  NeighbourTable table;
  table.of.resize(cloud.size());
  parallel_each(raster.rows, kRowsPerChunk, threads, [&](std::size_t row) {
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
  });
  return table;
}

}  // namespace palpate::search
