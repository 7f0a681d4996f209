#include "toolkit/smooth/seam_bricks.h"

#include <array>
#include <cmath>

namespace palpate::render {
namespace {

/// Both sides count so many voxels beyond the line, and are no more than so many apart there.
constexpr double kBesideSeam = 0.5;
constexpr float kTouches = 0.05f, kSeamNodes = 1.5f;

/// Which sides of a cube's seams count in it: those that the surface goes through, or close by. False where
/// sides do not touch along their line.
bool find_sides(const CubeSeams& seams, const NodeBlend& blend, const Vec3& middle, double voxel_mm,
                std::array<bool, kMostSeamSides>& counts) {
  counts.fill(false);
  const std::size_t lines = seams.lines(), sides = std::size_t{1} << lines;
  for (int x = 1; x + 1 < kBrickNodes; ++x)
    for (int y = 1; y + 1 < kBrickNodes; ++y)
      for (int z = 1; z + 1 < kBrickNodes; ++z) {
        const auto i = static_cast<std::size_t>((x * kBrickNodes + y) * kBrickNodes + z);
        const Vec3 at = middle + Vec3(x - 3, y - 3, z - 3) * voxel_mm;
        const std::size_t own = seams.side_of(at);
        const float here = blend.distance(own)[i];
        if (std::abs(here) > kSeamNodes) continue;
        std::size_t beside = 0;  // bits of the lines that are close by
        for (std::size_t k = 0; k < lines; ++k)
          if (std::abs(seams.past(k, at)) < kBesideSeam * voxel_mm) beside |= std::size_t{1} << k;
        for (std::size_t side = 0; side < sides; ++side) {
          if (((side ^ own) & ~beside) != 0) continue;
          counts[side] = true;
          if (std::abs(blend.distance(side)[i] - here) > kTouches) return false;
        }
      }
  return true;
}

}  // namespace

std::vector<Brick> seam_bricks(const CubeSeams& seams, const NodeBlend& blend, const Vec3& middle,
                               double voxel_mm) {
  std::array<bool, kMostSeamSides> counts;
  if (!find_sides(seams, blend, middle, voxel_mm, counts)) return {};
  // Lines of which both sides count.
  std::array<std::size_t, kMostSeamLines> both{};
  std::size_t lines_left = 0, first = 0;
  for (std::size_t k = 0; k < seams.lines(); ++k) {
    bool before = false, beyond = false;
    for (std::size_t side = 0; side < std::size_t{1} << seams.lines(); ++side)
      (((side >> k) & 1u) != 0 ? beyond : before) |= counts[side];
    if (before && beyond)
      both[lines_left++] = k;
    else if (beyond)
      first |= std::size_t{1} << k;
  }
  std::vector<Brick> bricks(std::size_t{1} << lines_left);
  for (std::size_t next = 0; next < bricks.size(); ++next) {
    std::size_t side = first;
    for (std::size_t k = 0; k < lines_left; ++k)
      if (((next >> k) & 1u) != 0) side |= std::size_t{1} << both[k];
    Brick& brick = bricks[next];
    brick.put(blend.distance(side));
    if (next + 1 < bricks.size()) brick.set(0, Joint::kSeam);
    if (next == 0 || next > lines_left) continue;
    const Seam& line = seams.line(both[next - 1]);
    const Vec3 corner = middle - Vec3::Constant(kHalfCells * voxel_mm);
    brick.set_line(line.across, line.across.dot(line.at - corner) / voxel_mm);
  }
  return bricks;
}

}  // namespace palpate::render
