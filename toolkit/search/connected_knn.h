// Connected kNN, and kNN cut off by density: the two further criteria of section 3.2.2.1.
#pragma once

#include <palpate/cloud.h>
#include <cstddef>
#include <cstdint>

#include "toolkit/search/neighbour_table.h"

namespace palpate::search {

struct ConnectReport {
  std::uint64_t pieces = 0;       ///< components of the links, ignoring direction
  std::uint64_t unreached = 0;    ///< points not reachable along links from the first point
  std::uint64_t links_given = 0;  ///< links added, in free slots or those of unused links
  double longest_link_mm = 0.0;   ///< of the added links
};

/// Makes the neighbour graph connected. Section 3.2.2.1: "ensuring that the resulting neighborhood map is
/// completely connected (by compiling the neighborhood information recursively rather than iteratively)". Our
/// reading: the map grows from the first point, and every point must be reachable along links. Reached points
/// give a link to the nearest unreached point that lists them; unlinked pieces are joined both ways at their
/// closest pairs (the shortest set of joints). A new link takes a free slot, or that of the farthest unused
/// link; rows stay ordered by (distance, index). O(n log n), single-threaded.
ConnectReport connect(const cloud::Cloud& cloud, NeighbourTable& table);

/// exact_knn, connected.
[[nodiscard]] NeighbourTable connected_knn(const cloud::Cloud& cloud, int threads,
                                           ConnectReport* report = nullptr);

struct CutOffReport {
  std::uint64_t links_cut = 0;
  std::uint64_t points_cut = 0;      ///< points that lost a link
  std::uint64_t points_without = 0;  ///< points that lost all links
};

/// Removes neighbours farther than `factor` local spacings: the threshold of section 3.2.2.1, "related to the
/// point cloud's density in the area being examined". The relation is not printed. Ours: the local spacing is
/// the median, over the point and its neighbours, of the distance to their fourth neighbour (one spacing on a
/// square grid). Rows keep their order. Parallel; independent of the number of threads. O(n).
CutOffReport cut_off_by_density(const cloud::Cloud& cloud, NeighbourTable& table, double factor, int threads);

struct WalkableReport {
  std::size_t spread = 0;    ///< points whose eight nearest were in a row or on one side
  std::size_t returned = 0;  ///< points that received links back
};

/// Repairs rows that trap a walk: all eight nearest in one scan line or dense clump. Neither repair changes
/// evenly spaced points. First, rows in a line or on one side choose eight of the 24 nearest in different
/// directions: a candidate drops back if a kept one is nearer to it than the point is, and the nearest
/// dropped ones fill up. Second, if p lists q, q does not list p, and no neighbour of q is nearer to p, then
/// q gets the link and chooses likewise. Rows stay ordered by (distance, index). Parallel; independent of the
/// number of threads. O(n).
WalkableReport make_walkable(const cloud::Cloud& cloud, NeighbourTable& table, int threads);

}  // namespace palpate::search
