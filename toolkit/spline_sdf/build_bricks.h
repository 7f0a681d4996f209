// Samples the patches' distance field near the surface as spline bricks, smaller where a spline cannot follow
// it.
#pragma once

#include <span>

#include "toolkit/spline_sdf/brick_grid.h"
#include "toolkit/spline_sdf/fit_patches.h"

namespace palpate::render {

struct BrickBuildOptions {
  double voxel_mm = 1.0;  ///< of bricks for the common spacing
  int levels = BrickGrid::kFineLevels;
  double noise_mm = 0.0;      ///< of the points
  double tolerance_mm = 0.0;  ///< spline error beyond which smaller bricks are used
  bool both_sides = false;    ///< pieces with holes are felt from both sides, even if they enclose a volume
};

/// `piece`: the connected piece of each patch. Independent of the number of threads. O(points).
[[nodiscard]] BrickGrid build_bricks(const MortonPoints& points, std::span<const QuadricPatch> patches,
                                     std::span<const std::uint32_t> piece,
                                     std::span<const PointPatches> of_points, const BrickBuildOptions& build,
                                     int threads);

}  // namespace palpate::render
