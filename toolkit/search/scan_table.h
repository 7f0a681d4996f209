// The look-up table of section 3.6.1: each point's position in the scan and its scan neighbours. Supports
// holes, and several scans of one object.
#pragma once

#include <cstdint>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/result.h>
#include "toolkit/search/neighbour_table.h"

namespace palpate::search {

/// Least rows or columns of a whole turn; with fewer, next and previous coincide.
inline constexpr std::uint32_t kMinWrapCount = 3;

struct ScanPosition {
  std::uint32_t scan = 0, row = 0, column = 0;
  friend bool operator==(const ScanPosition&, const ScanPosition&) = default;
};

/// One position per point, in the cloud's order; all distinct.
struct ScanTable {
  std::vector<ScanPosition> of;
  /// Columns (rows) of a whole turn, where the first follows the last; 0: no wrap.
  std::uint32_t columns_wrap = 0, rows_wrap = 0;
};

/// From cloud.raster. An Error without one, or if it does not match the number of points.
[[nodiscard]] Result<ScanTable> scan_table_of_raster(const cloud::Cloud& cloud);

/// From the properties `row`, `column` and optionally `scan` (text columns, PLY properties, or those left by
/// reading an organised PCD or raster PLY with holes). Integers from 0 to 2^24, else an Error that names the
/// point.
[[nodiscard]] Result<ScanTable> scan_table_of_properties(const cloud::Cloud& cloud);

/// From the raster if there is one, else from the properties.
[[nodiscard]] Result<ScanTable> scan_table_of(const cloud::Cloud& cloud);

struct LookupOptions {
  /// Missing positions that a link may skip, per direction; 0: only adjacent ones. Links are mutual. The
  /// thesis says nothing on holes.
  std::uint32_t across = 2;
};

struct LookupReport {
  std::uint64_t links_across_holes = 0;
  std::uint64_t fewer_than_eight = 0;  ///< points
};

/// Neighbours at the eight positions around, or the next beyond holes, within one scan. An Error if the table
/// does not match the cloud or two points share a position. O(n); independent of the number of threads.
[[nodiscard]] Result<NeighbourTable> lookup_table(const cloud::Cloud& cloud, const ScanTable& table,
                                                  const LookupOptions& options, int threads,
                                                  LookupReport* report = nullptr);

}  // namespace palpate::search
