#include "toolkit/spline_sdf/point_noise.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include <Eigen/Geometry>
#include "toolkit/core/parallel.h"
#include "toolkit/core/statistics.h"
#include "toolkit/spline_sdf/point_interior.h"

namespace palpate::spline_sdf {

namespace {

/// With fewer points the ball grows, with more it shrinks; half and twice an even distribution, with
/// tolerance.
constexpr std::size_t kMinSeedPoints = 9, kMaxSeedPoints = 34;
constexpr int kMaxResizes = 6;  // factor of eight up or down
constexpr double kBallGrowth = std::numbers::sqrt2;
/// If the local spacing is within this factor of the median, the median is used first.
constexpr double kEven = 1.5;
/// Least variance ratio: near zero on one scan line, a quarter on a half disc, the same on a corner's
/// quarter.
constexpr double kMinRoundness = 0.2;
/// Growth steps across a density step: up to four times as far.
constexpr int kMaxDensityGrowths = 4;
/// Points steeper above the ball's plane belong to another sheet.
constexpr double kSteep = 0.5;
constexpr std::size_t kNoiseSamples = 600;
/// Radius of noise measurement: about 30 points for 6 coefficients.
constexpr double kNoiseRadiusSpacings = 3.1;
/// Farther off the first quadric a point is on another sheet, such as a wall's far side: four times the
/// largest noise that can be fitted (0.3 spacings).
constexpr double kOneSheetSpacings = 1.2;

bool gather_enough_points(const MortonPoints& points, std::size_t i, Ball& ball) {
  double spacing = points.spacing_mm();
  const double here = points.spacing_near(i);
  if (here > kEven * spacing || kEven * here < spacing) spacing = here;
  double radius = kSeedRadiusSpacings * spacing;
  int last = 0;
  for (int k = 0; k < kMaxResizes; ++k) {
    ball.gather(points, points[i], radius);
    if (ball.away.size() < kMinSeedPoints && last <= 0) {
      radius *= kBallGrowth;
      last = -1;
    } else if (ball.away.size() > kMaxSeedPoints && last >= 0) {
      radius /= kBallGrowth;
      last = 1;
    } else {
      return ball.away.size() >= kMinSeedPoints;
    }
  }
  return false;
}

/// For points on one scan line: grows over the next lines, one step beyond the first that shows any.
bool take_more_lines(const MortonPoints& points, Ball& ball, Spread& spread) {
  if (!spread_of(ball, spread)) return false;
  for (int k = 0; spread.roundness < kMinRoundness; ++k) {
    if (k == kMaxResizes) return false;
    const double radius = kBallGrowth * ball.radius;
    ball.gather(points, ball.centre, radius);
    if (!spread_of(ball, spread)) return false;
    if (spread.roundness < kMinRoundness) continue;
    ball.gather(points, ball.centre, kBallGrowth * radius);
    return spread_of(ball, spread);
  }
  return true;
}

/// If the ball's points end on one side: grows to the nearest points beyond, within what their spacing
/// explains.
void reach_over_density_step(const MortonPoints& points, const Vec3& normal, Ball& ball) {
  const Vec3 axis = std::abs(normal.x()) < 0.5 ? Vec3::UnitX() : Vec3::UnitY();
  const Vec3 u = normal.cross(axis).normalized(), v = normal.cross(u);
  SectorMask near;
  for (const Vec3& d : ball.away)
    if (d.squaredNorm() > 0.0) near.add(d.dot(u), d.dot(v));
  if (!near.open()) return;
  double radius = ball.radius;
  Ball wide;
  wide.gather(points, ball.centre, radius * std::pow(kBallGrowth, kMaxDensityGrowths));
  for (int k = 0; k < kMaxDensityGrowths; ++k) {
    const double inner_sq = radius * radius;
    radius *= kBallGrowth;
    for (std::size_t j = 0; j < wide.away.size(); ++j) {
      const Vec3& d = wide.away[j];
      const double sq = d.squaredNorm(), tells = kInfluenceSpacings * points.spacing_near(wide.place[j]);
      if (sq <= inner_sq || sq > std::min(radius * radius, tells * tells)) continue;
      const double along = d.dot(normal);
      if (along * along < kSteep * kSteep * sq) near.add(d.dot(u), d.dot(v));
    }
    if (near.open()) continue;
    ball.gather(points, ball.centre, radius);
    return;
  }
}

}  // namespace

bool gather_seed_ball(const MortonPoints& points, std::size_t i, Ball& ball) {
  Spread spread;
  if (!gather_enough_points(points, i, ball) || !take_more_lines(points, ball, spread)) return false;
  reach_over_density_step(points, spread.normal, ball);
  return true;
}

double NoiseEstimator::noise_at(const MortonPoints& points, std::size_t i, double& spacing) {
  QuadricFit fit, first;
  if (!gather_seed_ball(points, i, ball_)) return -1.0;
  spacing = ball_.radius / kSeedRadiusSpacings;
  const bool known = fit_quadric(ball_, {}, nullptr, first);
  ball_.gather(points, points[i], kNoiseRadiusSpacings * spacing);
  if (known) ball_.keep_near(first.quadric, kOneSheetSpacings * spacing);
  if (!fit_quadric(ball_, {}, nullptr, fit)) return -1.0;
  static_cast<void>(separate_sheets(ball_, spacing, 0.0, fit));
  return fit.sigma;
}

double estimate_noise(const MortonPoints& points, int threads) {
  const std::size_t n = points.size();
  const std::size_t stride = std::max<std::size_t>(n / kNoiseSamples, 1);
  const std::size_t samples = (n + stride - 1) / stride;
  std::vector<double> sigma(samples, -1.0);
  parallel_chunks(samples, 16, threads, [&](std::size_t begin, std::size_t end) {
    NoiseEstimator probe;
    double spacing = 0.0;
    for (std::size_t i = begin; i < end; ++i) sigma[i] = probe.noise_at(points, i * stride, spacing);
  });
  std::erase_if(sigma, [](double s) { return s < 0.0; });
  if (sigma.empty()) return 0.0;
  return upper_median(std::move(sigma));
}

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

}  // namespace

NoiseField::NoiseField(const MortonPoints& points, int threads, bool everywhere) {
  const double median = estimate_noise(points, threads);
  if (everywhere)
    median_ = median;
  else
    *this = NoiseField(points, median, threads);
}

NoiseField::NoiseField(const MortonPoints& points, double median_mm, int threads) : median_(median_mm) {
  if (!(median_ > kNoisySpacings * points.spacing_mm())) return;
  blocks_.assign(points.blocks().begin(), points.blocks().end());
  std::vector<std::uint32_t> places;
  for (std::size_t b = 0; b + 1 < blocks_.size(); ++b) {
    firsts_.push_back(static_cast<std::uint32_t>(places.size()));
    for (std::uint32_t i = blocks_[b]; i < blocks_[b + 1]; i += kStride)
      places.push_back(std::min<std::uint32_t>(i + kStride / 2, blocks_[b + 1] - 1));
  }
  constexpr float kNotSeen = -1.0f;
  std::vector<float> seen(points.size(), kNotSeen);
  std::vector<double> spacing(places.size(), 0.0);
  parallel_chunks(places.size(), kFieldGrain, threads, [&](std::size_t begin, std::size_t end) {
    NoiseEstimator probe;
    for (std::size_t k = begin; k < end; ++k)
      seen[places[k]] = static_cast<float>(probe.noise_at(points, places[k], spacing[k]));
  });
  around_.assign(places.size(), static_cast<float>(median_));
  parallel_chunks(places.size(), kFieldGrain, threads, [&](std::size_t begin, std::size_t end) {
    std::vector<double> near;
    for (std::size_t k = begin; k < end; ++k) {
      if (seen[places[k]] < 0.0f) continue;
      near.clear();
      points.in_ball(points[places[k]], kAroundSpacings * spacing[k],
                     [&](std::uint32_t i, const Vec3&, double) {
                       if (seen[i] >= 0.0f) near.push_back(static_cast<double>(seen[i]));
                     });
      const double here = upper_median(near);
      if (here > kMoreByChance * median_) around_[k] = static_cast<float>(here);
    }
  });
}

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
  out.layer_distance_mm = upper_median(std::move(apart));
  return out;
}

}  // namespace palpate::spline_sdf
