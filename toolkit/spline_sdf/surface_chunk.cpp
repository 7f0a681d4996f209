#include "toolkit/spline_sdf/surface_chunk.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "toolkit/spline_sdf/orient_patches.h"

namespace palpate::spline_sdf {
namespace {

/// Spacings from a patch's middle to the last node that it gives a distance: the support of the largest patch
/// (16), eight voxels and a tile's half diagonal (18).
constexpr double kPatchTells = 36.0;
/// Spacings around a block in which points inform its patches: the largest ball (18), and the median of the
/// noise (16) about places of balls of 3.1.
constexpr double kPointTells = 40.0;

/// Where patches are needed.
geometry::Aabb patches_of(const BrickRegion& region, const BrickGrid& lattice, double spacing_mm) {
  return region.grown(kRegionMargin).cubes_mm(lattice).grown(kPatchTells * spacing_mm);
}

/// Sparse parts have the spacing of the largest bricks.
double largest_spacing_mm(const SurfaceFrame& frame) {
  return std::ldexp(frame.measured.spacing_mm, frame.coarser);
}

/// Numbers pieces and groups from 0, as they are met.
class PieceNumbers {
 public:
  explicit PieceNumbers(const OrientedPieces& of)
      : of_(of), piece_(of.piece.size(), kNone), group_(of.group.size(), kNone) {}

  std::uint32_t number(std::uint32_t piece, std::vector<std::uint32_t>& groups) {
    if (piece_[piece] != kNone) return piece_[piece];
    piece_[piece] = static_cast<std::uint32_t>(groups.size());
    // A group's number is that of one of its patches before outlying pieces were dropped.
    const std::uint32_t group = of_.group[piece];
    groups.push_back(group == OrientedPieces::kOutward ? group : group_number(group));
    return piece_[piece];
  }

 private:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  std::uint32_t group_number(std::uint32_t group) {
    if (group >= group_.size()) group_.resize(group + 1, kNone);
    if (group_[group] == kNone) group_[group] = groups_++;
    return group_[group];
  }

  const OrientedPieces& of_;
  std::vector<std::uint32_t> piece_, group_;
  std::uint32_t groups_ = 0;
};

}  // namespace

double SurfaceFrame::margin_mm() const noexcept {
  const BrickGrid grid = lattice();
  const double block_mm = 2.0 * points.block_spacings * measured.spacing_mm;
  // Rays go on in the sample where that is dense enough.
  return kRegionMargin * grid.cube_edge() * grid.voxel_mm + block_mm +
         kPatchTells * largest_spacing_mm(*this) +
         std::max(kPointTells * largest_spacing_mm(*this), kFarReach * far->spacing_mm());
}

SurfaceChunk build_surface_chunk(cloud::Cloud cloud, const BrickRegion& region, const SurfaceFrame& frame,
                                 int threads) {
  SurfaceChunk out;
  out.first_code = morton_code_of(region.low);
  SampledBricks sampled;
  OrientedPieces pieces;
  {
    MortonPoints points(cloud, &frame.points, threads);
    points.drop_order();
    cloud = {};
    const NoiseField noise(points, frame.measured.noise_mm, threads);
    const BrickGrid lattice = frame.lattice();
    const geometry::Aabb where = patches_of(region, lattice, largest_spacing_mm(frame));
    FittedPatches cover = fit_patches(points, {frame.build.detail, noise}, threads, &where);
    drop_outlier_patches(cover.patches, threads, &points);
    pieces = orient_outwards(points, cover.patches, threads, frame.far.get());
    const geometry::Aabb own_mm = region.cubes_mm(lattice);
    for (const QuadricPatch& patch : cover.patches)
      if (own_mm.contains(patch.quadric.at)) ++out.patches;
    const std::vector<PointPatches> of_points = assign_patches(points, cover.patches, threads);
    const BrickRegion around = region.grown(kRegionMargin);
    sampled = sample_bricks(points, cover.patches, pieces.piece, of_points,
                            brick_options(frame.measured, frame.build), &around, threads);
  }
  PieceNumbers numbers(pieces);
  const BrickRegion beside = region.grown(1), inner = region.grown(-1);
  std::vector<std::uint32_t> own;  // numbers of the grid's bricks, once they are collected
  std::uint32_t number = 0;
  for (int l = 0; l < sampled.grid.levels; ++l) {
    const auto at = static_cast<std::size_t>(l);
    for (std::size_t i = 0; i < sampled.made[at].size(); ++i) {
      const std::uint32_t brick = number++;
      const std::uint64_t code = sampled.codes[at][i];
      const BrickGrid::Coordinate cube = search::coordinate_of_code(code);
      if (!beside.contains(cube, l)) continue;
      ChunkBrick one{code, l, summary_of(sampled.made[at][i], code, l, sampled.grid)};
      const bool is_own = region.contains(cube, l);
      if (!is_own && (one.summary.smaller || one.summary.cells + one.summary.beyond == 0)) continue;
      one.summary.piece = numbers.number(one.summary.piece, out.groups);
      (is_own ? out.own : out.seam).push_back(one);
      if (!is_own) continue;
      own.push_back(brick);
      if (!inner.contains(cube, l)) out.rim.push_back(one);
    }
  }
  sampled.collect();
  add_distances(sampled.grid, *frame.sample, &region, out.distances);
  out.bricks.reserve(own.size());
  for (const std::uint32_t brick : own) out.bricks.push_back(sampled.grid.bricks[brick]);
  return out;
}

LevelCounts level_counts(const SurfaceChunk& chunk) {
  LevelCounts counts{};
  for (const ChunkBrick& one : chunk.own) ++counts[static_cast<std::size_t>(one.level)];
  return counts;
}

}  // namespace palpate::spline_sdf
