#include "toolkit/smooth/point_patches.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/parallel.h"

namespace palpate::render {
namespace {

/// A patch is followed beyond its support by this share of it and so many spacings: edges of faces lie within
/// a ring that its own points ended before.
constexpr double kBeyond = 1.15, kBeyondSpacings = 0.5;
/// A point is on a patch within so many standard deviations; of clean points so many spacings are one.
constexpr double kFollowSigmas = 3.5, kCleanSpacings = 0.02;
/// At its rim a patch counts this much of what it does in its middle.
constexpr double kRim = 0.02;
constexpr std::size_t kFollowGrain = 64;

struct Follows {
  std::uint32_t point, patch;
  float weight;
};

void find_followers(const SmoothPoints& points, const Patch& p, std::uint32_t patch,
                    std::vector<Follows>& out) {
  const Quadric& q = p.quadric;
  const double reach = kBeyond * p.support + kBeyondSpacings * p.spacing, reach_sq = reach * reach;
  const double sigma = std::max({p.sigma, p.noise, kCleanSpacings * p.spacing});
  // The quadric bends off its tangent plane: the ball takes what is over its disc.
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

std::vector<PointPatches> follow_patches(const SmoothPoints& points, std::span<const Patch> patches,
                                         int threads) {
  std::vector<std::vector<Follows>> found((patches.size() + kFollowGrain - 1) / kFollowGrain);
  parallel_chunks(patches.size(), kFollowGrain, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k)
      find_followers(points, patches[k], static_cast<std::uint32_t>(k), found[begin / kFollowGrain]);
  });
  std::vector<PointPatches> out(points.size());
  for (const std::vector<Follows>& chunk : found)
    for (Follows f : chunk) {
      // In the order of the patches, so equal weights keep the first.
      PointPatches& mine = out[f.point];
      for (std::size_t k = 0; k < kPatchesOfPoint; ++k)
        if (mine.patch[k] == PointPatches::kNone || f.weight > mine.share[k]) {
          std::swap(mine.patch[k], f.patch);
          std::swap(mine.share[k], f.weight);
          if (f.patch == PointPatches::kNone) break;
        }
    }
  parallel_chunks(points.size(), kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      float sum = 0.0f;
      for (const float share : out[i].share) sum += share;
      if (!(sum > 0.0f)) continue;
      for (float& share : out[i].share) share /= sum;
    }
  });
  return out;
}

}  // namespace palpate::render
