#include "toolkit/spline_sdf/fit_patches.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/parallel.h"

namespace palpate::spline_sdf {
namespace {

/// Points follow a patch beyond its support by this share and this many spacings: face edges lie in a ring
/// beyond its own points.
constexpr double kBeyond = 1.15, kBeyondSpacings = 0.5;
/// A point is on a patch within this many standard deviations; for clean points this many spacings stand for
/// one.
constexpr double kFollowSigmas = 3.5, kCleanSpacings = 0.02;
/// A patch's weight at its rim, relative to its centre.
constexpr double kRim = 0.02;
constexpr std::size_t kFollowGrain = 64;
/// Patches assigned at a time: 64 grains, whose some 100 points each are still in the cache when they are
/// merged. All at once would take more memory than the points.
constexpr std::size_t kPatchesAtOnce = 64 * kFollowGrain;

struct Assignment {
  std::uint32_t point, patch;
  float weight;
};

void find_assigned_points(const MortonPoints& points, const QuadricPatch& p, std::uint32_t patch,
                          std::vector<Assignment>& out) {
  const Quadric& q = p.quadric;
  const double reach = kBeyond * p.support + kBeyondSpacings * p.spacing, reach_sq = reach * reach;
  const double sigma = std::max({p.sigma, p.noise, kCleanSpacings * p.spacing});
  // The quadric bends off its tangent plane, so the ball is enlarged to cover its disc.
  const double bend = (std::abs(q.uu) + std::abs(q.uv) + std::abs(q.vv)) * reach_sq;
  points.in_ball(q.at, std::hypot(reach, bend + kFollowSigmas * sigma),
                 [&](std::uint32_t i, const Vec3& d, double) {
                   const double a = d.dot(q.u), b = d.dot(q.v), lateral_sq = a * a + b * b;
                   if (lateral_sq > reach_sq) return;
                   const double off = (d.dot(q.n) - (q.uu * a * a + q.uv * a * b + q.vv * b * b)) / sigma;
                   if (std::abs(off) > kFollowSigmas) return;
                   const double inner = std::max(1.0 - lateral_sq / reach_sq, kRim);
                   const double weight = inner * inner * std::exp(-0.5 * off * off) * p.trust;
                   out.push_back({i, patch, static_cast<float>(weight)});
                 });
}

}  // namespace

std::vector<PointPatches> assign_patches(const MortonPoints& points, std::span<const QuadricPatch> patches,
                                         int threads) {
  std::vector<PointPatches> out(points.size());
  for (std::size_t first = 0; first < patches.size(); first += kPatchesAtOnce) {
    const auto found = parallel_parts<std::vector<Assignment>>(
        std::min(patches.size() - first, kPatchesAtOnce), kFollowGrain, threads,
        [&](std::size_t k, std::vector<Assignment>& mine) {
          find_assigned_points(points, patches[first + k], static_cast<std::uint32_t>(first + k), mine);
        });
    for (const std::vector<Assignment>& chunk : found)
      for (Assignment f : chunk) {
        // In patch order, so ties keep the first.
        PointPatches& mine = out[f.point];
        for (std::size_t k = 0; k < kPatchesOfPoint; ++k)
          if (mine.patch[k] == PointPatches::kNone || f.weight > mine.share[k]) {
            std::swap(mine.patch[k], f.patch);
            std::swap(mine.share[k], f.weight);
            if (f.patch == PointPatches::kNone) break;
          }
      }
  }
  parallel_each(points.size(), kPointsPerChunk, threads, [&](std::size_t i) {
    float sum = 0.0f;
    for (const float share : out[i].share) sum += share;
    if (!(sum > 0.0f)) return;
    for (float& share : out[i].share) share /= sum;
  });
  return out;
}

}  // namespace palpate::spline_sdf
