// The initial points of a patch: the fewest that determine a quadric, on all sides if possible.
#pragma once

#include "toolkit/spline_sdf/quadric.h"

namespace palpate::render {

/// Radius of a first ball in spacings: 15 points, a little over twice what a quadric needs.
inline constexpr double kSeedRadiusSpacings = 2.2;

/// The points around point i: enough, on more than one scan line, and across a density step. Radius /
/// kSeedRadiusSpacings is the local spacing. False if the point stands alone.
[[nodiscard]] bool gather_seed_ball(const MortonPoints& points, std::size_t i, Ball& ball);

/// The noise at single places. Belongs to one thread.
class NoiseEstimator {
 public:
  /// Noise about a quadric around point i, mm, and the local spacing; negative if the point stands alone.
  [[nodiscard]] double noise_at(const MortonPoints& points, std::size_t i, double& spacing);

 private:
  Ball ball_;
};

/// The points' noise about a smooth surface, mm: median of some hundred places. O(1).
[[nodiscard]] double estimate_noise(const MortonPoints& points, int threads);

}  // namespace palpate::render
