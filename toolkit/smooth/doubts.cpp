#include "toolkit/smooth/doubts.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "toolkit/core/parallel.h"
#include "toolkit/smooth/first_ball.h"

namespace palpate::render {
namespace {

constexpr std::size_t kDoubtSamples = 600, kDoubtGrain = 16;
/// Some 30 points are looked at, as for the noise.
constexpr double kDoubtRadius = 3.1;
constexpr int kFewestLooked = 16;
/// Points that fill a ball lie some 0.4 of its radius off any quadric; those of a surface whose noise is as
/// large as their spacing a third.
constexpr double kFillsBall = 0.35;
/// Fourth moment over the square of the second: 1 of two layers, 1.5 where each is so thick that they are two
/// and a half standard deviations off their middle, 1.8 of points anywhere between two planes, 3 of noise.
constexpr double kTwoLayers = 1.5;
/// Of two layers over each other half of the points or more stand next to one of the other layer, seen along
/// the normal; of the bands in which a scanner's steps lie few do.
constexpr double kMixedLayers = 0.3;
/// Layers nearer than this share of the spacing are what rounding leaves.
constexpr double kLeastApart = 0.005;

struct Looked {
  bool asked = false, scattered = false;
  double apart_mm = 0.0;  ///< of two layers, else 0
};

/// Points of a ball, seen along a quadric's normal.
struct Seen {
  double a, b, off;
};

/// The share of points whose next one is on the other side.
double mixed_share(const std::vector<Seen>& seen) {
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

Looked look_at(const SmoothPoints& points, std::size_t i, double noise, Ball& ball) {
  Looked out;
  if (!gather_first(points, i, ball)) return out;
  out.asked = true;
  const double spacing = ball.radius / kFirstRadius;
  QuadricFit fit;
  // What the cover tells apart is no doubt.
  if (fit_quadric(ball, {noise, true}, nullptr, fit) && separate_sheets(ball, spacing, noise, fit))
    return out;
  ball.gather(points, points[i], kDoubtRadius * spacing);
  if (ball.away.size() < kFewestLooked || !fit_quadric(ball, {0.0, false}, nullptr, fit)) return out;
  std::vector<Seen> seen;
  double mean = 0.0;
  for (const Vec3& away : ball.away) {
    const Vec3 p = ball.centre + away, d = p - fit.quadric.at;
    seen.push_back({d.dot(fit.quadric.u), d.dot(fit.quadric.v), fit.quadric.residual(p)});
    mean += seen.back().off;
  }
  const auto count = static_cast<double>(seen.size());
  mean /= count;
  double second = 0.0, fourth = 0.0;
  for (Seen& one : seen) {
    one.off -= mean;
    const double square = one.off * one.off;
    second += square / count;
    fourth += square * square / count;
  }
  out.scattered = second > kFillsBall * kFillsBall * ball.radius * ball.radius;
  const double apart = 2.0 * std::sqrt(second);
  if (!out.scattered && apart > kLeastApart * spacing && fourth < kTwoLayers * second * second &&
      mixed_share(seen) > kMixedLayers)
    out.apart_mm = apart;
  return out;
}

}  // namespace

PointDoubts find_doubts(const SmoothPoints& points, double noise, int threads) {
  const std::size_t n = points.size(), stride = std::max<std::size_t>(n / kDoubtSamples, 1);
  std::vector<Looked> looked((n + stride - 1) / stride);
  parallel_chunks(looked.size(), kDoubtGrain, threads, [&](std::size_t begin, std::size_t end) {
    Ball ball;
    for (std::size_t k = begin; k < end; ++k) looked[k] = look_at(points, k * stride, noise, ball);
  });
  PointDoubts out;
  std::vector<double> apart;
  std::size_t asked = 0, scattered = 0;
  for (const Looked& one : looked) {
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
  out.layers_mm = *middle;
  return out;
}

}  // namespace palpate::render
