#include "toolkit/spline_sdf/input_quality.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "toolkit/core/parallel.h"
#include "toolkit/spline_sdf/seed_ball.h"

namespace palpate::render {
namespace {

constexpr std::size_t kQualitySamples = 600, kQualityGrain = 16;
/// Radius with about 30 points, as for the noise.
constexpr double kQualityRadius = 3.1;
constexpr int kMinQualityPoints = 16;
/// Points that fill a ball lie about 0.4 of its radius off any quadric; surface points with noise as large as
/// their spacing a third.
constexpr double kFillsBall = 0.35;
/// Kurtosis threshold for two layers: 1 for thin layers, 1.5 where their distance is five standard deviations
/// of each, 1.8 uniform between planes, 3 for noise.
constexpr double kTwoLayers = 1.5;
/// In two layers at least half of the points have a neighbour of the other layer along the normal; in the
/// bands of a scanner's steps few do.
constexpr double kMixedLayers = 0.3;
/// Layers nearer than this share of the spacing come from rounding.
constexpr double kMinApart = 0.005;

struct SampleQuality {
  bool asked = false, scattered = false;
  double apart_mm = 0.0;  ///< for two layers, else 0
};

/// A point projected to a quadric's normal.
struct ProjectedPoint {
  double a, b, off;
};

/// The share of points whose next one is on the other side.
double interleaved_share(const std::vector<ProjectedPoint>& seen) {
  int mixed = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    double nearest = std::numeric_limits<double>::infinity();
    bool other = false;
    for (std::size_t j = 0; j < seen.size(); ++j) {
      const double a = seen[i].a - seen[j].a, b = seen[i].b - seen[j].b, sq = a * a + b * b;
      if (j == i || !(sq < nearest)) continue;
      nearest = sq;
      other = (seen[i].off > 0.0) != (seen[j].off > 0.0);
    }
    mixed += other ? 1 : 0;
  }
  return static_cast<double>(mixed) / static_cast<double>(seen.size());
}

SampleQuality assess_sample(const MortonPoints& points, std::size_t i, double noise, Ball& ball) {
  SampleQuality out;
  if (!gather_seed_ball(points, i, ball)) return out;
  out.asked = true;
  const double spacing = ball.radius / kSeedRadiusSpacings;
  QuadricFit fit;
  // Sheets that the cover separates are not doubtful.
  if (fit_quadric(ball, {noise, true}, nullptr, fit) && separate_sheets(ball, spacing, noise, fit))
    return out;
  ball.gather(points, points[i], kQualityRadius * spacing);
  if (ball.away.size() < kMinQualityPoints || !fit_quadric(ball, {0.0, false}, nullptr, fit)) return out;
  std::vector<ProjectedPoint> seen;
  double mean = 0.0;
  for (const Vec3& away : ball.away) {
    const Vec3 p = ball.centre + away, d = p - fit.quadric.at;
    seen.push_back({d.dot(fit.quadric.u), d.dot(fit.quadric.v), fit.quadric.residual(p)});
    mean += seen.back().off;
  }
  const auto count = static_cast<double>(seen.size());
  mean /= count;
  double second = 0.0, fourth = 0.0;
  for (ProjectedPoint& one : seen) {
    one.off -= mean;
    const double square = one.off * one.off;
    second += square / count;
    fourth += square * square / count;
  }
  out.scattered = second > kFillsBall * kFillsBall * ball.radius * ball.radius;
  const double apart = 2.0 * std::sqrt(second);
  if (!out.scattered && apart > kMinApart * spacing && fourth < kTwoLayers * second * second &&
      interleaved_share(seen) > kMixedLayers)
    out.apart_mm = apart;
  return out;
}

}  // namespace

InputQuality assess_input_quality(const MortonPoints& points, double noise, int threads) {
  const std::size_t n = points.size(), stride = std::max<std::size_t>(n / kQualitySamples, 1);
  std::vector<SampleQuality> looked((n + stride - 1) / stride);
  parallel_chunks(looked.size(), kQualityGrain, threads, [&](std::size_t begin, std::size_t end) {
    Ball ball;
    for (std::size_t k = begin; k < end; ++k) looked[k] = assess_sample(points, k * stride, noise, ball);
  });
  InputQuality out;
  std::vector<double> apart;
  std::size_t asked = 0, scattered = 0;
  for (const SampleQuality& one : looked) {
    asked += one.asked ? 1 : 0;
    scattered += one.scattered ? 1 : 0;
    if (one.apart_mm > 0.0) apart.push_back(one.apart_mm);
  }
  if (asked == 0) return out;
  const auto all = static_cast<double>(asked);
  out.layered = static_cast<double>(apart.size()) / all;
  out.scattered = static_cast<double>(scattered) / all;
  if (apart.empty()) return out;
  const auto middle = apart.begin() + static_cast<std::ptrdiff_t>(apart.size() / 2);
  std::nth_element(apart.begin(), middle, apart.end());
  out.layer_distance_mm = *middle;
  return out;
}

}  // namespace palpate::render
