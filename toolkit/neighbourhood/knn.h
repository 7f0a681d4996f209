// Builders of neighbourhood information over a whole cloud. All are parallel and give the same result with
// any number of threads: neighbours are ordered by (distance, index), distances squared in double from the
// stored coordinates.
#pragma once

#include <cstdint>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::neighbourhood {

/// The eight nearest other points of every point. Points at the same place count as neighbours at distance 0.
/// The reference for every other builder. O(n) for clouds of bounded density variation.
[[nodiscard]] NeighbourTable exact_knn(const cloud::Cloud& cloud, int threads);

/// sqrt(occupied area / points): the length that start_size is given in. The area is counted in cells of
/// about six points, so it is that of a surface; O(n).
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
  std::uint64_t stopped_at_limit = 0;  ///< points whose cube reached the growth limit (the second rule)
  std::uint64_t fewer_than_eight = 0;
};

[[nodiscard]] NeighbourTable modified_knn(const cloud::Cloud& cloud, const ModifiedKnnOptions& options,
                                          int threads, ModifiedKnnReport* report = nullptr);

/// Section 3.2.2.4: the eight neighbours of (row, column) in a full raster, whatever its order; fewer at its
/// borders, none of which are where it wraps around. Needs cloud.raster.
[[nodiscard]] Result<NeighbourTable> scanner_path(const cloud::Cloud& cloud, int threads);
/// The same for a raster that the cloud does not carry but was recognised (cloud::find_raster) or is known.
[[nodiscard]] Result<NeighbourTable> scanner_path(const cloud::Cloud& cloud, const cloud::ScanRaster& raster,
                                                  int threads);

/// Share of points whose neighbour sets are equal, whatever their order.
struct Agreement {
  std::uint64_t points = 0;
  std::uint64_t equal_sets = 0;
  std::uint64_t interior_points = 0;  ///< points with eight neighbours in both
  std::uint64_t interior_equal = 0;
};
[[nodiscard]] Agreement agreement(const NeighbourTable& a, const NeighbourTable& b);

}  // namespace palpate::neighbourhood
