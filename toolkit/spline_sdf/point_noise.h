// The noise of the points about a smooth surface: at single places, around each point, and whether
// any surface fits them at all.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/spline_sdf/morton_points.h"
#include "toolkit/spline_sdf/quadric.h"

namespace palpate::spline_sdf {

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

// The local noise of the points. Registered scans are rough where they overlap and fine elsewhere, and a fit
// with the wrong noise takes noise for shape.

/// Standard deviation of the points about a smooth surface, mm. Immutable.
class NoiseField {
 public:
  NoiseField() = default;
  /// Parallel; independent of the number of threads and of the points' order. O(n / 64) fits if the points
  /// are noisy. `everywhere`: one value for all places.
  NoiseField(const MortonPoints& points, int threads, bool everywhere = false);
  /// The same with a median that is known.
  NoiseField(const MortonPoints& points, double median_mm, int threads);

  /// The median over some hundred samples.
  [[nodiscard]] double median() const noexcept { return median_; }
  /// Around point i; at least the median.
  [[nodiscard]] double at(std::size_t i) const noexcept {
    if (around_.empty()) return median_;
    const auto next = std::upper_bound(blocks_.begin(), blocks_.end(), i);
    const auto block = static_cast<std::size_t>(next - blocks_.begin()) - 1;
    return static_cast<double>(around_[firsts_[block] + (i - blocks_[block]) / kStride]);
  }

 private:
  static constexpr std::size_t kStride = 64;
  double median_ = 0.0;
  std::vector<float> around_;                   ///< per kStride points of a block; empty: the same everywhere
  std::vector<std::uint32_t> blocks_, firsts_;  ///< MortonPoints::blocks(), and the first of each in around_
};

// Detects points that no smooth two-sided surface fits.

/// Shares of some hundred sampled places.
struct InputQuality {
  double layered = 0.0;            ///< the points form two layers too close to separate
  double layer_distance_mm = 0.0;  ///< median distance of these layers
  double scattered = 0.0;          ///< the points fill a ball instead of a surface
};

/// `noise`: estimate_noise() of the points, mm. O(1), parallel; independent of the number of threads.
[[nodiscard]] InputQuality assess_input_quality(const MortonPoints& points, double noise, int threads);

}  // namespace palpate::spline_sdf
