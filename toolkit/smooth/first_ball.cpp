#include "toolkit/smooth/first_ball.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "toolkit/core/parallel.h"
#include "toolkit/smooth/surround.h"

namespace palpate::render {
namespace {

/// Fewer points: the ball is widened; more: narrowed. Half and twice what an even set has, but for luck.
constexpr std::size_t kFewest = 9, kMost = 34;
constexpr int kMaxResizes = 6;  // eight times as far, or near
constexpr double kBallGrowth = std::numbers::sqrt2;
/// Where the spacing nearby differs by less than this from the model's median, the median is begun with.
constexpr double kEven = 1.5;
/// Of points on one scan line the variance across is next to nothing; of half a disc it is a quarter of that
/// along, of a corner's quarter as much.
constexpr double kLeastRoundness = 0.2;
/// How often the ball may grow to reach over a step of density: four times as far.
constexpr int kReachOver = 4;
/// Points this steep above the plane of a ball are another sheet's.
constexpr double kSteep = 0.5;
constexpr std::size_t kNoiseSamples = 600;
/// The radius that noise is measured in: some 30 points against 6 numbers.
constexpr double kNoiseRadiusSpacings = 3.1;
/// Farther off the first ball's quadric a point is of another sheet, as of the far side of a wall: four times
/// the noise that fits can be made through (0.3 spacings).
constexpr double kOneSheetSpacings = 1.2;

bool gather_enough(const SmoothPoints& points, std::size_t i, Ball& ball) {
  double spacing = points.spacing_mm();
  const double here = points.spacing_near(i);
  if (here > kEven * spacing || kEven * here < spacing) spacing = here;
  double radius = kFirstRadius * spacing;
  int last = 0;
  for (int k = 0; k < kMaxResizes; ++k) {
    ball.gather(points, points[i], radius);
    if (ball.away.size() < kFewest && last <= 0) {
      radius *= kBallGrowth;
      last = -1;
    } else if (ball.away.size() > kMost && last >= 0) {
      radius /= kBallGrowth;
      last = 1;
    } else {
      return ball.away.size() >= kFewest;
    }
  }
  return false;
}

/// Over the lines on either side, where the points were all on one: one step more than tells of any.
bool take_more_lines(const SmoothPoints& points, Ball& ball, Spread& spread) {
  if (!spread_of(ball, spread)) return false;
  for (int k = 0; spread.roundness < kLeastRoundness; ++k) {
    if (k == kMaxResizes) return false;
    const double radius = kBallGrowth * ball.radius;
    ball.gather(points, ball.centre, radius);
    if (!spread_of(ball, spread)) return false;
    if (spread.roundness < kLeastRoundness) continue;
    ball.gather(points, ball.centre, kBallGrowth * radius);
    return spread_of(ball, spread);
  }
  return true;
}

/// Where a ball's points end on one side, it is widened to the nearest ones beyond that are not farther off
/// than their own spacing explains.
void reach_over(const SmoothPoints& points, const Vec3& normal, Ball& ball) {
  const Vec3 axis = std::abs(normal.x()) < 0.5 ? Vec3::UnitX() : Vec3::UnitY();
  const Vec3 u = normal.cross(axis).normalized(), v = normal.cross(u);
  Surround near;
  for (const Vec3& d : ball.away)
    if (d.squaredNorm() > 0.0) near.add(d.dot(u), d.dot(v));
  if (!near.open()) return;
  double radius = ball.radius;
  Ball wide;
  wide.gather(points, ball.centre, radius * std::pow(kBallGrowth, kReachOver));
  for (int k = 0; k < kReachOver; ++k) {
    const double inner_sq = radius * radius;
    radius *= kBallGrowth;
    for (std::size_t j = 0; j < wide.away.size(); ++j) {
      const Vec3& d = wide.away[j];
      const double sq = d.squaredNorm(), tells = kTellsSpacings * points.spacing_near(wide.place[j]);
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

bool gather_first(const SmoothPoints& points, std::size_t i, Ball& ball) {
  Spread spread;
  if (!gather_enough(points, i, ball) || !take_more_lines(points, ball, spread)) return false;
  reach_over(points, spread.normal, ball);
  return true;
}

double NoiseProbe::noise_at(const SmoothPoints& points, std::size_t i, double& spacing) {
  QuadricFit fit, first;
  if (!gather_first(points, i, ball_)) return -1.0;
  spacing = ball_.radius / kFirstRadius;
  const bool known = fit_quadric(ball_, {}, nullptr, first);
  ball_.gather(points, points[i], kNoiseRadiusSpacings * spacing);
  if (known) ball_.keep_near(first.quadric, kOneSheetSpacings * spacing);
  if (!fit_quadric(ball_, {}, nullptr, fit)) return -1.0;
  static_cast<void>(separate_sheets(ball_, spacing, 0.0, fit));
  return fit.sigma;
}

double measure_noise(const SmoothPoints& points, int threads) {
  const std::size_t n = points.size();
  const std::size_t stride = std::max<std::size_t>(n / kNoiseSamples, 1);
  const std::size_t samples = (n + stride - 1) / stride;
  std::vector<double> sigma(samples, -1.0);
  parallel_chunks(samples, 16, threads, [&](std::size_t begin, std::size_t end) {
    NoiseProbe probe;
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
