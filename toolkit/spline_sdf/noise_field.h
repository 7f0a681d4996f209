// The local noise of the points. Registered scans are rough where they overlap and fine elsewhere, and a fit
// with the wrong noise takes noise for shape.
#pragma once

#include <cstddef>
#include <vector>

#include "toolkit/spline_sdf/morton_points.h"

namespace palpate::render {

/// Standard deviation of the points about a smooth surface, mm. Immutable.
class NoiseField {
 public:
  NoiseField() = default;
  /// Parallel; independent of the number of threads and of the points' order. O(n / 64) fits if the points
  /// are noisy. `everywhere`: one value for all places.
  NoiseField(const MortonPoints& points, int threads, bool everywhere = false);

  /// The median over some hundred samples.
  [[nodiscard]] double median() const noexcept { return median_; }
  /// Around point i; at least the median.
  [[nodiscard]] double at(std::size_t i) const noexcept {
    return around_.empty() ? median_ : static_cast<double>(around_[i / kStride]);
  }

 private:
  static constexpr std::size_t kStride = 64;
  double median_ = 0.0;
  std::vector<float> around_;  ///< per kStride points; empty: the same everywhere
};

}  // namespace palpate::render
