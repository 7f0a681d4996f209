// Small patches that lie over a crease of two larger ones. In noise they are as good a fit as smaller ones
// would be, but round the crease off, and join its faces.
#pragma once

#include <vector>

#include "toolkit/smooth/cover.h"

namespace palpate::render {

/// Puts two pieces in the place of each patch whose points two larger patches explain better by a fold: one
/// of each of these. Keeps the order of the others. The same for any number of threads.
/// O(patches x overlaps).
void part_folded(const SmoothPoints& points, std::vector<Patch>& patches, int threads);

}  // namespace palpate::render
