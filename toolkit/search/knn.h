// Builders of neighbour tables for a whole cloud. All are parallel and independent of the number of threads;
// neighbours are ordered by (distance, index), with squared distances in double from stored coordinates.
#pragma once

#include <palpate/cloud.h>
#include <palpate/result.h>
#include <cstdint>

#include "toolkit/search/neighbour_table.h"

namespace palpate::search {

/// The eight nearest other points of every point; coincident points are neighbours at distance 0. The
/// reference for all other builders. O(n) for clouds of bounded density variation.
[[nodiscard]] NeighbourTable exact_knn(const cloud::Cloud& cloud, int threads);

/// sqrt(occupied area / points), the unit of start_size. The area is counted in cells of about six points, so
/// it is that of a surface; O(n).
[[nodiscard]] double mean_spacing_mm(const cloud::Cloud& cloud);

/// Section 3.2.2.5.
struct ModifiedKnnOptions {
  bool complete_to_eight = true;  ///< ours; false is the printed form, which may find fewer than eight
  double start_size = 1.0;        ///< first cube edge, in units of mean_spacing_mm(); not printed
  double refinement =
      0.70710678118654752;     ///< factor between sizes, in (0, 1); not printed. Halves a cube's face
  double growth_limit = 64.0;  ///< largest cube edge in units of the first: the second stopping rule
};

struct ModifiedKnnReport {
  std::uint64_t stopped_at_nine = 0;   ///< points whose block held at most nine
  std::uint64_t stopped_at_limit = 0;  ///< points whose cube reached the growth limit (second rule)
  std::uint64_t fewer_than_eight = 0;
};

[[nodiscard]] NeighbourTable modified_knn(const cloud::Cloud& cloud, const ModifiedKnnOptions& options,
                                          int threads, ModifiedKnnReport* report = nullptr);

/// Section 3.2.2.4: the eight neighbours of (row, column) in a full raster of any order; fewer at borders
/// that do not wrap. Needs cloud.raster.
[[nodiscard]] Result<NeighbourTable> scanner_path(const cloud::Cloud& cloud, int threads);
/// The same for a raster that was recognised (cloud::find_raster) or is known otherwise.
[[nodiscard]] Result<NeighbourTable> scanner_path(const cloud::Cloud& cloud, const cloud::ScanRaster& raster,
                                                  int threads);

/// The share of points with equal neighbour sets, in any order.
struct Agreement {
  std::uint64_t points = 0;
  std::uint64_t equal_sets = 0;
  std::uint64_t interior_points = 0;  ///< points with eight neighbours in both
  std::uint64_t interior_equal = 0;
};
[[nodiscard]] Agreement agreement(const NeighbourTable& a, const NeighbourTable& b);

struct FixedDistanceOptions {
  /// mm, inclusive. 0: 1.68 mean spacings, the geometric middle between a square grid's eighth neighbour at
  /// 1.41 and ninth at 2. The thesis prints no distance.
  double distance_mm = 0.0;
};

struct FixedDistanceReport {
  double distance_mm = 0.0;                                 ///< as used
  std::uint64_t more_than_eight = 0, fewer_than_eight = 0;  ///< points
  /// Total neighbours within the distance, which unbounded lists would hold (four bytes each). Of coincident
  /// points nine are counted.
  std::uint64_t within = 0;
};

/// Rows hold the nearest eight within the distance. O(points within the distance, summed).
[[nodiscard]] NeighbourTable fixed_distance(const cloud::Cloud& cloud, const FixedDistanceOptions& options,
                                            int threads, FixedDistanceReport* report = nullptr);

}  // namespace palpate::search
