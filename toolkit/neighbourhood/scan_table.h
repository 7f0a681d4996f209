// The explicit look-up table of section 3.6.1: where in the scan each point was taken, and who was taken next
// to it. Also for scans with holes, and for several scans of one object.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::neighbourhood {

/// Rows or columns of a whole turn, at least: below three the next and the last before are one.
inline constexpr std::uint32_t kLeastRound = 3;

struct ScanPosition {
  std::uint32_t scan = 0, row = 0, column = 0;
  friend bool operator==(const ScanPosition&, const ScanPosition&) = default;
};

/// One position per point, in the cloud's own order; no two alike.
struct ScanTable {
  std::vector<ScanPosition> of;
  /// Columns (rows) of a whole turn, where the first is next to the last; 0: they do not wrap.
  std::uint32_t columns_wrap = 0, rows_wrap = 0;
};

/// From cloud.raster. An Error without one, or where it does not match the number of points.
[[nodiscard]] Result<ScanTable> scan_table_of_raster(const cloud::Cloud& cloud);

/// From the cloud's properties `row`, `column` and, where there are several scans, `scan`: columns of a text
/// file, properties of a PLY, or what reading leaves of an organised PCD or a raster PLY with holes. Whole
/// numbers from 0 to 2^24, else an Error that names the point.
[[nodiscard]] Result<ScanTable> scan_table_of_properties(const cloud::Cloud& cloud);

/// From the raster where there is one, else from the properties.
[[nodiscard]] Result<ScanTable> scan_table_of(const cloud::Cloud& cloud);

struct LookupOptions {
  /// Missing positions in a row that a link passes over, in each of the eight directions; 0: only the eight
  /// around. Links are mutual either way. Nothing is printed on holes.
  std::uint32_t across = 2;
};

struct LookupReport {
  std::uint64_t links_across_holes = 0;
  std::uint64_t fewer_than_eight = 0;  ///< points
};

/// The points at the eight positions around, or the next ones beyond holes, in the same scan; points of
/// different scans are no neighbours. An Error where the table does not match the cloud or two points stand
/// at one position. O(n); the same for any number of threads.
[[nodiscard]] Result<NeighbourTable> lookup_table(const cloud::Cloud& cloud, const ScanTable& table,
                                                  const LookupOptions& options, int threads,
                                                  LookupReport* report = nullptr);

}  // namespace palpate::neighbourhood
