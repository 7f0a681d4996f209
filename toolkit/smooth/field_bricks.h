// From patches to bricks: the field of distance sampled where the surface is, as coefficients of splines, in
// smaller bricks where the spline would not follow it.
#pragma once

#include <span>

#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/cover.h"
#include "toolkit/smooth/point_patches.h"

namespace palpate::render {

struct FieldBuild {
  double voxel_mm = 1.0;  ///< of the bricks that most points' spacing asks for
  int levels = BrickGrid::kFineLevels;
  double noise_mm = 0.0;      ///< of the points
  double tolerance_mm = 0.0;  ///< that a spline may be off the field by before smaller bricks take its place
  bool both_sides = false;  ///< pieces with holes are felt from both sides, even where they enclose a volume
};

/// `piece`: of each patch its connected piece. The same for any number of threads. O(points).
[[nodiscard]] BrickGrid build_bricks(const SmoothPoints& points, std::span<const Patch> patches,
                                     std::span<const std::uint32_t> piece,
                                     std::span<const PointPatches> of_points, const FieldBuild& build,
                                     int threads);

}  // namespace palpate::render
