// Makes a table of nearest neighbours fit to be walked.
#pragma once

#include <cstddef>

#include "toolkit/cloud/cloud.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::neighbourhood {

struct WalkableReport {
  std::size_t spread = 0;    ///< points whose eight nearest stood in a row or to one side
  std::size_t returned = 0;  ///< points that were given links back
};

/// The eight nearest of a point may all stand in one scan line, or in one dense clump: a walk along them
/// never comes to the next line, or never out of the clump. Two mendings, both of which change nothing where
/// points lie evenly. First, where the eight stand in a row or to one side, eight are chosen anew from the 24
/// nearest so that they go different ways: one falls behind when another already kept is nearer to it than
/// the point is; the nearest of those behind fill up. Second, where a point p lists q, q does not list p, and
/// none of q's neighbours is nearer to p than q is, q is given the link back, and eight are chosen likewise.
/// Rows stay ordered by (distance, index). Parallel; the same for any number of threads. O(n).
WalkableReport make_walkable(const cloud::Cloud& cloud, NeighbourTable& table, int threads);

}  // namespace palpate::neighbourhood
