// Spacing of a cloud from its neighbours: the thesis's resolution, and how even the points are.
#pragma once

#include <cstdint>

#include <palpate/cloud.h>
#include "toolkit/search/neighbour_table.h"

namespace palpate::search {

/// Nearest-rank percentiles, mm.
struct Percentiles {
  double min = 0.0, p50 = 0.0, p99 = 0.0, p999 = 0.0, max = 0.0;
};

struct Spacing {
  /// Section 1.6: the largest distance between immediate neighbours, over all pairs of the table, mm.
  double resolution_mm = 0.0;
  /// The same without z, as the thesis prints for height fields (table 7: 0.1414 against 0.288 in 3D).
  double plan_resolution_mm = 0.0;
  /// From every distinct position to the nearest other.
  Percentiles nearest_mm;
  /// From every point to its last neighbour: the local resolution.
  Percentiles eighth_mm;
  /// Positions repeated so often that the table has no other neighbour; not in nearest_mm.
  std::uint64_t without_nearest = 0;
  /// Median over distinct positions of the smallest |i - j| to a non-coincident neighbour: 1 in scanner
  /// order, large if shuffled.
  double median_index_distance = 0.0;
  /// resolution_mm <= kHighResolutionMm: the thesis's "highly detailed".
  bool high_resolution = false;
};

/// `table` belongs to `cloud`. For a raster use the scanner-path table (the source of the printed values),
/// else exact nearest neighbours. O(n log n); zeros without neighbours.
[[nodiscard]] Spacing describe_spacing(const cloud::Cloud& cloud, const NeighbourTable& table);

}  // namespace palpate::search
