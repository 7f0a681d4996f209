// Groups patches into connected pieces and orients them outward.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/spline_sdf/fit_patches.h"

namespace palpate::render {

/// Turns the patches' normals outward, drops stray pieces, and returns each kept patch's piece number (its
/// least index).
/// Smoothly continuing patches form faces. A face's outer side is the one from which more directions escape
/// all points; undecided faces follow those they meet. Independent of the number of threads. O(patches x
/// overlaps).
[[nodiscard]] std::vector<std::uint32_t> orient_outwards(const MortonPoints& points,
                                                         std::vector<QuadricPatch>& patches, int threads);

/// Drops unreliable patches that lie off a reliable one where that has points on all sides. Keeps the order;
/// independent of the number of threads. O(patches x overlaps).
void drop_outlier_patches(std::vector<QuadricPatch>& patches, int threads);

}  // namespace palpate::render
