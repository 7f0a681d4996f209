// Which patches are one piece of surface, and which side of each is the outer one.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/smooth/cover.h"

namespace palpate::render {

/// Turns the normals of the patches outwards and leaves out stray pieces. Of each patch that stays: a number
/// of its connected piece, the least index in it.
///
/// Patches that continue each other smoothly form faces. A face is turned by what is seen from it: the side
/// from which more directions lead away from all points is the outer one. Faces from which that cannot be
/// told are turned as the faces that they meet. The same for any number of threads. O(patches x overlaps).
[[nodiscard]] std::vector<std::uint32_t> turn_outwards(const SmoothPoints& points,
                                                       std::vector<Patch>& patches, int threads);

}  // namespace palpate::render
