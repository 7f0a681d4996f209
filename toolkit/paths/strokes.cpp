#include "toolkit/paths/path_shapes.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/random.h"

namespace palpate::paths {
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
