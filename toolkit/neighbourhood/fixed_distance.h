// Fixed distance neighbours: all points within a distance (section 3.2.2.2).
#pragma once

#include <cstdint>

#include "toolkit/cloud/cloud.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::neighbourhood {

struct FixedDistanceOptions {
  /// mm, inclusive. 0: 1.68 times the cloud's mean spacing, midway (as a ratio) between the eighth neighbour
  /// of a square grid at 1.41 spacings and the ninth at 2. The thesis prints no distance.
  double distance_mm = 0.0;
};

struct FixedDistanceReport {
  double distance_mm = 0.0;                                 ///< as used
  std::uint64_t more_than_eight = 0, fewer_than_eight = 0;  ///< points
  /// Neighbours within the distance, over all points: what lists without an end would hold (four bytes each).
  /// Of more than nine points at one place nine are counted.
  std::uint64_t within = 0;
};

/// Every row holds the nearest eight of those within the distance. O(points within the distance, summed).
[[nodiscard]] NeighbourTable fixed_distance(const cloud::Cloud& cloud, const FixedDistanceOptions& options,
                                            int threads, FixedDistanceReport* report = nullptr);

}  // namespace palpate::neighbourhood
