// From patches to bricks: which cubes the surface goes through, which patches are one sheet there, and the
// spline's coefficients blended of them.
#pragma once

#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/cover.h"
#include "toolkit/smooth/patch_links.h"
#include "toolkit/smooth/seams.h"

namespace palpate::render {

/// The same for any number of threads. O(patches x bricks near each).
[[nodiscard]] BrickGrid bake_bricks(const SmoothPoints& points, const std::vector<Patch>& patches,
                                    const PatchLinks& links, const Seams& seams, double voxel_mm, int threads,
                                    const SmoothWithout& without = {});

}  // namespace palpate::render
