#include "toolkit/spline_sdf/closed_components.h"

#include <algorithm>
#include <bit>

#include "toolkit/core/parallel.h"
#include "toolkit/core/radix_sort.h"

namespace palpate::render {
namespace {

/// A brick is made if a point lies within this many spacings of it: the surface stays that close to its
/// points, and the side of a HIP must be known slightly off the surface.
constexpr double kMargin = 1.0;
/// Share of the area that is sampled more coarsely than the spacing of the largest bricks.
constexpr double kCoarseArea = 0.5;

}  // namespace

void sort_unique(std::vector<std::uint64_t>& codes, int threads) {
  std::uint64_t bits = 0;
  for (const std::uint64_t code : codes) bits |= code;
  radix_sort(codes, static_cast<int>(std::bit_width(bits)), threads, [](std::uint64_t code) { return code; });
  codes.erase(std::unique(codes.begin(), codes.end()), codes.end());
}

int coarser_levels(const MortonPoints& points, std::span<const PointPatches> of_points) {
  if (!(points.spacing_mm() > 0.0)) return 0;
  std::vector<double> spacings;
  double area = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (of_points[i].patch[0] == PointPatches::kNone) continue;
    spacings.push_back(points.spacing_near(i));
    area += spacings.back() * spacings.back();
  }
  std::sort(spacings.begin(), spacings.end());
  double finer = 0.0, coarse = points.spacing_mm();
  for (const double spacing : spacings) {
    coarse = spacing;
    finer += spacing * spacing;
    if (finer >= (1.0 - kCoarseArea) * area) break;
  }
  int levels = 0;
  for (double at = 2.0 * points.spacing_mm(); at <= coarse && levels < BrickGrid::kMaxCoarser; at *= 2.0)
    ++levels;
  return levels;
}

void add_cubes_near_points(const MortonPoints& points, std::span<const PointPatches> of_points,
                           const BrickGrid& grid, int level, int threads,
                           const std::function<bool(std::uint64_t)>& wanted,
                           std::vector<std::uint64_t>& codes) {
  const double per = grid.per_voxel * grid.per_voxel_of(level) / kBrickCells;
  const auto last = static_cast<double>(((grid.last_brick + 1) << level) - 1);
  std::vector<std::vector<std::uint64_t>> found((points.size() + kPointsPerChunk - 1) / kPointsPerChunk);
  parallel_chunks(points.size(), kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    std::vector<std::uint64_t>& mine = found[begin / kPointsPerChunk];
    for (std::size_t i = begin; i < end; ++i) {
      if (of_points[i].patch[0] == PointPatches::kNone) continue;
      const Vec3 at = (points[i] - grid.low_mm) * per;
      // Points farther apart than a cube have larger ones.
      const Vec3 off = Vec3::Constant(std::min(kMargin * points.spacing_near(i) * per, 1.0));
      const Vec3 low = (at - off).cwiseMax(0.0), high = (at + off).cwiseMin(last);
      for (auto x = static_cast<std::int32_t>(low.x()); x <= static_cast<std::int32_t>(high.x()); ++x)
        for (auto y = static_cast<std::int32_t>(low.y()); y <= static_cast<std::int32_t>(high.y()); ++y)
          for (auto z = static_cast<std::int32_t>(low.z()); z <= static_cast<std::int32_t>(high.z()); ++z) {
            const std::uint64_t code = morton_code_of({x, y, z});
            if ((mine.empty() || mine.back() != code) && wanted(code)) mine.push_back(code);
          }
    }
    std::sort(mine.begin(), mine.end());
    mine.erase(std::unique(mine.begin(), mine.end()), mine.end());
  });
  for (const std::vector<std::uint64_t>& f : found) codes.insert(codes.end(), f.begin(), f.end());
  sort_unique(codes, threads);
}

}  // namespace palpate::render
