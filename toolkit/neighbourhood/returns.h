// Links back: makes a neighbour table fit to be walked.
#pragma once

#include <cstddef>

#include "toolkit/cloud/cloud.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::neighbourhood {

/// The eight nearest of a point may all belong to one dense clump, as scans have many: a walk that comes in
/// never comes out again. Where a point p lists q, q does not list p, and none of q's neighbours is nearer to
/// p than q is, q is given the link back; of more than eight the ones kept go different ways (a candidate
/// falls behind when one already kept is nearer to it than q is), then the nearest fill up. Rows stay ordered
/// by (distance, index). Returns how many points were changed. Parallel; the same for any number of threads.
/// O(n).
std::size_t add_missing_returns(const cloud::Cloud& cloud, NeighbourTable& table, int threads);

}  // namespace palpate::neighbourhood
