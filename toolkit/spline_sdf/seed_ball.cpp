#include "toolkit/spline_sdf/seed_ball.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "toolkit/core/parallel.h"
#include "toolkit/spline_sdf/point_interior.h"

namespace palpate::render {
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
  const auto middle = sigma.begin() + static_cast<std::ptrdiff_t>(sigma.size() / 2);
  std::nth_element(sigma.begin(), middle, sigma.end());
  return *middle;
}

}  // namespace palpate::render
