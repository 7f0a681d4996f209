// kNN that hangs together, and kNN cut off by density: the two further criteria of section 3.2.2.1.
#pragma once

#include <cstdint>

#include "toolkit/cloud/cloud.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::neighbourhood {

struct ConnectReport {
  std::uint64_t pieces = 0;       ///< that the links left, whatever their direction
  std::uint64_t unreached = 0;    ///< points that no walk along links from the first point came to
  std::uint64_t links_given = 0;  ///< new links, each in a free place or that of a link nothing hangs on
  double longest_link_mm = 0.0;   ///< of the new links
};

/// Section 3.2.2.1: "ensuring that the resulting neighborhood map is completely connected (by compiling the
/// neighborhood information recursively rather than iteratively)". Our reading: the map is compiled outwards
/// from the first point, and every point must be come to along links. Points already come to hand a link to
/// the nearest of those that list them and are not; pieces with no link between them are joined at their
/// closest pairs (the shortest set of joints there is), both ways. A new link takes a
/// free place, or that of the farthest link that nothing hangs on; rows stay ordered by (distance, index).
/// Afterwards every point is reached from the first one. O(n log n), on one thread.
ConnectReport connect(const cloud::Cloud& cloud, NeighbourTable& table);

/// exact_knn, connected.
[[nodiscard]] NeighbourTable connected_knn(const cloud::Cloud& cloud, int threads,
                                           ConnectReport* report = nullptr);

struct CutOffReport {
  std::uint64_t links_cut = 0;
  std::uint64_t points_cut = 0;      ///< points that lost a link
  std::uint64_t points_without = 0;  ///< points that lost all
};

/// The threshold of section 3.2.2.1, "related to the point cloud's density in the area being examined": a
/// neighbour farther than `factor` local spacings is none. The relation is not printed. Ours: the local
/// spacing is the median, over the point and its neighbours, of the distance to the fourth of their own (one
/// spacing on a square grid, where half of the eight stand at one spacing). Rows keep their order. Parallel;
/// the same for any number of threads. O(n).
CutOffReport cut_off_by_density(const cloud::Cloud& cloud, NeighbourTable& table, double factor, int threads);

}  // namespace palpate::neighbourhood
