// What neighbours say about a cloud: resolution as the thesis defines it, and how evenly points stand.
#pragma once

#include <cstdint>

#include "toolkit/cloud/cloud.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::neighbourhood {

/// Nearest-rank percentiles, mm.
struct Percentiles {
  double min = 0.0, p50 = 0.0, p99 = 0.0, p999 = 0.0, max = 0.0;
};

struct Spacing {
  /// Section 1.6: the largest distance between immediate neighbours, over every pair of the table, mm.
  double resolution_mm = 0.0;
  /// The same with z left out: what the thesis prints for height fields (table 7: 0.1414 against 0.288 in
  /// 3D).
  double plan_resolution_mm = 0.0;
  /// From every distinct position to the nearest other one.
  Percentiles nearest_mm;
  /// From every point to the last neighbour of the table: the local resolution.
  Percentiles eighth_mm;
  /// Positions so often repeated that the table knows no neighbour elsewhere: not in nearest_mm.
  std::uint64_t without_nearest = 0;
  /// Median over the distinct positions of the smallest |i - j| to a neighbour at another one: 1 where points
  /// stand in the order of a scanner, large where they are shuffled.
  double median_index_distance = 0.0;
  /// resolution_mm <= kHighResolutionMm: the thesis's "highly detailed".
  bool high_resolution = false;
};

/// `table` belongs to `cloud`. Give the scanner-path table where the cloud is a raster (that is where the
/// printed values come from) and exact nearest neighbours elsewhere. O(n log n); no neighbours at all gives
/// zeros.
[[nodiscard]] Spacing describe_spacing(const cloud::Cloud& cloud, const NeighbourTable& table);

}  // namespace palpate::neighbourhood
