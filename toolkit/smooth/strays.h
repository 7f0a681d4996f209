// Small patches beside a surface that is known there: stray points, and what bridges them and the surface.
#pragma once

#include <vector>

#include "toolkit/smooth/cover.h"

namespace palpate::render {

/// Leaves out the patches that are not beyond doubt and lie off one that is, where that one has points on all
/// sides. Keeps the order of the others. The same for any number of threads. O(patches x overlaps).
void drop_beside_sure(std::vector<Patch>& patches, int threads);

}  // namespace palpate::render
