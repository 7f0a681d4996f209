// The bricks of one sheet in a cube through which seams pass: one for each side of them.
#pragma once

#include <vector>

#include "toolkit/smooth/blend.h"
#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/cube_seams.h"

namespace palpate::render {

/// `blend` holds each side's distance at the nodes, by side; `middle` of the cube. One brick where the
/// surface is all on one side; none where the sides do not touch along their line.
[[nodiscard]] std::vector<Brick> seam_bricks(const CubeSeams& seams, const NodeBlend& blend,
                                             const Vec3& middle, double voxel_mm);

}  // namespace palpate::render
