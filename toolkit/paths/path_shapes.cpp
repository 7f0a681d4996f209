#include "toolkit/paths/path_shapes.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

#include "toolkit/core/random.h"

namespace palpate::paths {
namespace {

// Relative error of steps of the surface point.
constexpr double kStepAccuracy = 1e-9;
constexpr int kRootSteps = 80;   // halvings that exhaust a double
constexpr int kGrowSteps = 200;  // doublings from the first guess to anywhere

/// Back and forth between 0 and 1.
double triangle_wave(double x) {
  const double rest = std::fmod(x, 2.0);
  return rest < 1.0 ? rest : 2.0 - rest;
}

}  // namespace

double advance(const std::function<Vec3(double)>& point, double tau, double step, double guess) {
  const Vec3 from = point(tau);
  const auto excess = [&](double ahead) { return (point(tau + ahead) - from).norm() - step; };
  double low = 0.0, high = guess, at_low = -step, at_high = excess(high);
  for (int i = 0; at_high < 0.0; ++i) {
    if (i == kGrowSteps) return -1.0;
    low = high;
    at_low = at_high;
    high *= 2.0;
    at_high = excess(high);
  }
  // False position, Illinois rule: an end that stays gets half its weight.
  int stayed = 0;
  for (int i = 0; i < kRootSteps; ++i) {
    const double middle = (low * at_high - high * at_low) / (at_high - at_low);
    const double at_middle = excess(middle);
    if (std::abs(at_middle) <= kStepAccuracy * step) return tau + middle;
    if (at_middle < 0.0) {
      low = middle;
      at_low = at_middle;
      if (stayed == -1) at_high *= 0.5;
      stayed = -1;
    } else {
      high = middle;
      at_high = at_middle;
      if (stayed == 1) at_low *= 0.5;
      stayed = 1;
    }
  }
  return tau + high;
}

Vec3 limit_step(const Vec3& last, const Vec3& wish, double farthest_mm) {
  const Vec3 way = wish - last;
  return way.norm() > farthest_mm ? Vec3(last + way * (farthest_mm / way.norm())) : wish;
}

Curve weave_curve(std::uint64_t seed) {
  Random random(seed);
  const double phase_u = 2.0 * std::numbers::pi * random.uniform(),
               phase_v = 2.0 * std::numbers::pi * random.uniform();
  return [=](double tau) {
    return SurfaceParameters{0.5 + kParameterHalfSpan * std::sin(tau + phase_u),
                             0.5 + kParameterHalfSpan * std::sin(std::numbers::phi * tau + phase_v)};
  };
}

Curve raster_curve(double lines) {
  return [=](double tau) {
    // tau counts lines; a tenth of each unit steps to the next line. At the end it runs back.
    constexpr double kOnLine = 0.9;
    const double along = lines * triangle_wave(tau / lines);
    const double line = std::min(std::floor(along), lines - 1.0);
    const double part = along - line;
    const double run = std::min(1.0, part / kOnLine),
                 shift = std::max(0.0, (part - kOnLine) / (1.0 - kOnLine));
    const double u = std::fmod(line, 2.0) == 0.0 ? run : 1.0 - run;
    const double v = lines > 1.0 ? std::min(1.0, (line + shift) / (lines - 1.0)) : 0.5;
    return SurfaceParameters{0.5 + kParameterHalfSpan * (2.0 * u - 1.0),
                             0.5 + kParameterHalfSpan * (2.0 * v - 1.0)};
  };
}

Curve spiral_curve(double turns) {
  return [=](double tau) {
    const double r = kParameterHalfSpan * triangle_wave(1.0 + tau / turns),
                 angle = 2.0 * std::numbers::pi * tau;
    return SurfaceParameters{0.5 + r * std::cos(angle), 0.5 + r * std::sin(angle)};
  };
}

std::vector<Vec3> tap(const geometry::SurfacePoint& at, const PathTiming& timing) {
  std::vector<Vec3> path(timing.frames);
  for (std::size_t k = 0; k < timing.frames; ++k) path[k] = at.point_mm + timing.offset_mm(k) * at.normal;
  return path;
}

std::vector<Vec3> hold(const geometry::SurfacePoint& at, double tremor_mm, const PathTiming& timing) {
  constexpr double kTremorHz = 10.0;  // physiological tremor is 8 to 12 Hz
  const auto arrival = static_cast<std::size_t>(0.5 * timing.period_frames);
  const Vec3 side = (std::abs(at.normal.x()) < 0.5 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::UnitY()))
                        .cross(at.normal)
                        .normalized();
  std::vector<Vec3> path(timing.frames);
  for (std::size_t k = 0; k < timing.frames; ++k) {
    path[k] = at.point_mm + (k < arrival ? timing.offset_mm(k) : -timing.depth_mm) * at.normal;
    if (k < arrival || tremor_mm == 0.0) continue;
    const double turn =
        2.0 * std::numbers::pi * kTremorHz * static_cast<double>(k - arrival) / timing.rate_hz;
    path[k] += tremor_mm * (std::sin(turn) * at.normal + std::sin(std::numbers::phi * turn) * side);
  }
  return path;
}

Result<std::vector<Vec3>> slide(const std::vector<Vec3>& lower, const std::vector<Vec3>& upper,
                                const PathTiming& timing) {
  std::vector<Vec3> corners = {upper.front()};
  corners.insert(corners.end(), lower.begin(), lower.end());
  corners.insert(corners.end(), upper.rbegin(), upper.rend());
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  const auto length = [&](std::size_t side) { return (corners[side + 1] - corners[side]).norm(); };
  const std::size_t sides = corners.size() - 1;
  double round = 0.0;
  for (std::size_t side = 0; side < sides; ++side) round += length(side);
  if (!(timing.step_mm() < round)) return step_does_not_fit();
  std::vector<Vec3> path;
  path.reserve(timing.frames);
  std::size_t side = 0;
  double done = 0.0;
  while (path.size() < timing.frames) {
    path.push_back(corners[side] + (corners[side + 1] - corners[side]) * (done / length(side)));
    done += timing.step_mm();
    while (done >= length(side)) {
      done -= length(side);
      side = (side + 1) % sides;
    }
  }
  return path;
}

Error step_does_not_fit() {
  return {"the probe's step in one frame is larger than the model, or vanishes beside it",
          "choose a speed_mm_s that fits the model's size",
          {},
          0};
}

namespace {

/// Variation of a stroke's depth and height; none too shallow to be felt.
constexpr double kShallowest = 0.2, kHighest = 1.5;
/// Below this share of the clearance (or the stroke's depth, if less) the approach is at the stroke's own
/// speed.
constexpr double kNearSurface = 0.1;
/// Share of a slow stroke's time for going down, and for going up.
constexpr double kDownShare = 0.25;
/// Speed along the surface over the speed down: hands approach at a slant.
constexpr double kSlant = 0.5;
/// Distance to the next stroke, in stroke heights.
constexpr double kTravel = 2.0;

class Strokes {
 public:
  Strokes(const PathTiming& timing, const StrokeOptions& options)
      : timing_(timing), options_(options), random_(timing.seed) {
    paces_.reserve(timing.frames);
    offset_ = timing.clearance_mm;
    paces_.push_back({offset_, 0.0});
  }
  [[nodiscard]] std::vector<FrameStep> all() {
    while (!full()) stroke();
    return std::move(paces_);
  }

 private:
  [[nodiscard]] bool full() const { return paces_.size() >= timing_.frames; }
  [[nodiscard]] double step(double speed_mm_s) const { return speed_mm_s / timing_.rate_hz; }

  /// Straight to `offset` in steps of at most `step_mm`, moving along the surface meanwhile.
  void to(double offset, double step_mm, double along_mm) {
    const double from = offset_, way = std::abs(offset - from);
    const double pieces = std::max(1.0, std::ceil(way / step_mm));
    for (double i = 1.0; i <= pieces && !full(); i += 1.0)
      paces_.push_back({i == pieces ? offset : from + (offset - from) * (i / pieces), along_mm});
    offset_ = offset;
  }
  void along(double frames, double along_mm) {
    for (double i = 0.0; i < frames && !full(); i += 1.0) paces_.push_back({offset_, along_mm});
  }

  void stroke() {
    const double fast = step(options_.fastest_mm_s);
    const double slow = step(options_.slowest_mm_s) *
                        std::pow(options_.fastest_mm_s / options_.slowest_mm_s, random_.uniform());
    const double deep = timing_.depth_mm * random_.uniform(kShallowest, 1.0);
    const double high = timing_.clearance_mm * random_.uniform(1.0, kHighest);
    to(high, fast, 0.0);
    if (random_.uniform() < options_.impacts) {
      bounces_ = !bounces_;
      to(-timing_.depth_mm, fast, 0.0);
      if (!bounces_) along(std::floor(kDownShare * timing_.period_frames), slow);
      to(high, fast, 0.0);
    } else {
      const double depth = std::min(deep, kDownShare * timing_.period_frames * slow);
      const double near = std::min(kNearSurface * timing_.clearance_mm, depth);
      to(near, fast, 0.0);
      to(-depth, slow, kSlant * slow);
      along(std::floor((1.0 - 2.0 * kDownShare) * timing_.period_frames), slow);
      to(near, slow, kSlant * slow);
      to(high, fast, 0.0);
    }
    along(std::ceil(kTravel * (high + timing_.depth_mm) / fast), fast);
  }

  const PathTiming& timing_;
  const StrokeOptions& options_;
  Random random_;
  std::vector<FrameStep> paces_;
  double offset_ = 0.0;
  bool bounces_ = true;  // the first impact stays
};

}  // namespace

std::vector<FrameStep> strokes(const PathTiming& timing, const StrokeOptions& options) {
  return Strokes(timing, options).all();
}

}  // namespace palpate::paths
