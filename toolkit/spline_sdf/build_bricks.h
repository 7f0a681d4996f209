// Builds spline bricks from the patches' distance field. Bricks lie near the surface, smaller where a spline
// cannot follow it.
#pragma once

#include <span>
#include <vector>

#include "toolkit/spline_sdf/brick_components.h"
#include "toolkit/spline_sdf/brick_grid.h"
#include "toolkit/spline_sdf/fit_patches.h"

namespace palpate::spline_sdf {

struct BrickBuildOptions {
  double voxel_mm = 1.0;  ///< of bricks for the common spacing
  int levels = BrickGrid::kFineLevels;
  double noise_mm = 0.0;      ///< of the points
  double tolerance_mm = 0.0;  ///< spline error beyond which smaller bricks are used
  bool both_sides = false;    ///< pieces with holes are felt from both sides, even if they enclose a volume
  /// Bricks whose nodes are sampled at a time, or a sixteenth of a level's: some 40 MB. Changes no brick.
  std::size_t bricks_at_once = std::size_t{1} << 15;
};

/// `piece`: the connected piece of each patch. `of_points` is let go of before the bricks are copied, when
/// most memory is taken. Independent of the number of threads. O(points).
[[nodiscard]] BrickGrid build_bricks(const MortonPoints& points, std::span<const QuadricPatch> patches,
                                     std::span<const std::uint32_t> piece,
                                     std::vector<PointPatches> of_points, const BrickBuildOptions& build,
                                     int threads);

/// A part of a surface: what all decide, and which bricks are made.
struct BrickRegion {
  geometry::Aabb box_mm;                ///< of all points
  int coarser = 0;                      ///< BrickGrid::coarser
  BrickGrid::Coordinate low{}, past{};  ///< cubes of level 0

  [[nodiscard]] bool contains(const BrickGrid::Coordinate& cube, int level = 0) const noexcept {
    for (std::size_t a = 0; a < 3; ++a)
      if (cube[a] >> level < low[a] || cube[a] >> level >= past[a]) return false;
    return true;
  }
  [[nodiscard]] BrickRegion grown(std::int32_t cubes) const noexcept {
    BrickRegion out = *this;
    for (std::size_t a = 0; a < 3; ++a) out.low[a] -= cubes, out.past[a] += cubes;
    return out;
  }
  /// Of its cubes, on the lattice of `grid`.
  [[nodiscard]] geometry::Aabb cubes_mm(const BrickGrid& grid) const noexcept;
};
/// A brick is the same in every region that holds it with this many cubes around: two whose nodes its own
/// need, and at each level two more of half the size.
inline constexpr std::int32_t kRegionMargin = 4;

/// A grid without bricks over the points' box.
[[nodiscard]] BrickGrid brick_lattice(const geometry::Aabb& box_mm, double voxel_mm, int coarser);

/// Bricks before the pieces that they belong to are classified: `grid` has none yet.
struct SampledBricks {
  BrickGrid grid;
  LevelCodes codes;
  BuiltBricks made;

  /// Moves the bricks to the grid, level after level by code. O(bricks).
  void collect();
};
/// As build_bricks(); `region`: null for all.
[[nodiscard]] SampledBricks sample_bricks(const MortonPoints& points, std::span<const QuadricPatch> patches,
                                          std::span<const std::uint32_t> piece,
                                          std::span<const PointPatches> of_points,
                                          const BrickBuildOptions& build, const BrickRegion* region,
                                          int threads);

}  // namespace palpate::spline_sdf
