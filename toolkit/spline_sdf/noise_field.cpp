#include "toolkit/spline_sdf/noise_field.h"

#include <algorithm>
#include <cstdint>

#include "toolkit/core/parallel.h"
#include "toolkit/spline_sdf/seed_ball.h"

namespace palpate::render {
namespace {

/// Below this noise, in spacings, one value holds everywhere: deviations of clean points are shape.
constexpr double kNoisySpacings = 0.05;
/// Radius of the local median: 800 points, a dozen samples. A crease affects less than half of them (balls of
/// 3.1 spacings see it in a strip of 6.2), so not the median.
constexpr double kAroundSpacings = 16.0;
/// Smaller excess over the median is chance: a sample is accurate to a fifth, a median of a dozen to a
/// twelfth, and this is three of those.
constexpr double kMoreByChance = 1.25;
constexpr std::size_t kFieldGrain = 16;

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

NoiseField::NoiseField(const MortonPoints& points, int threads, bool everywhere)
    : median_(estimate_noise(points, threads)) {
  if (everywhere || !(median_ > kNoisySpacings * points.spacing_mm())) return;
  const std::size_t count = (points.size() + kStride - 1) / kStride;
  const auto place_of = [&](std::size_t k) { return std::min(k * kStride + kStride / 2, points.size() - 1); };
  std::vector<double> seen(count, -1.0), spacing(count, 0.0);
  parallel_chunks(count, kFieldGrain, threads, [&](std::size_t begin, std::size_t end) {
    NoiseEstimator probe;
    for (std::size_t k = begin; k < end; ++k) seen[k] = probe.noise_at(points, place_of(k), spacing[k]);
  });
  around_.assign(count, static_cast<float>(median_));
  parallel_chunks(count, kFieldGrain, threads, [&](std::size_t begin, std::size_t end) {
    std::vector<double> near;
    for (std::size_t k = begin; k < end; ++k) {
      if (seen[k] < 0.0) continue;
      near.clear();
      points.in_ball(points[place_of(k)], kAroundSpacings * spacing[k],
                     [&](std::uint32_t i, const Vec3&, double) {
                       if (place_of(i / kStride) == i && seen[i / kStride] >= 0.0)
                         near.push_back(seen[i / kStride]);
                     });
      const double here = median_of(near);
      if (here > kMoreByChance * median_) around_[k] = static_cast<float>(here);
    }
  });
}

}  // namespace palpate::render
