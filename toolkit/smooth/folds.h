// Small patches that lie over a crease of two larger ones. In noise they are as good a fit as the crease, but
// round it off, and join its faces.
#pragma once

#include <vector>

#include "toolkit/smooth/cover.h"

namespace palpate::render {

/// Leaves out patches whose points two larger patches explain as well by a fold, and keeps the order of the
/// others. The same for any number of threads. O(patches x overlaps).
void drop_folded(const SmoothPoints& points, double noise, std::vector<Patch>& patches, int threads);

}  // namespace palpate::render
