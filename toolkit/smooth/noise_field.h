// How noisy the points are, place by place: scans that were put together with an error of some spacings are
// rough where they overlap and fine elsewhere, and a fit that takes the one's noise for the other's finds
// shape in it.
#pragma once

#include <cstddef>
#include <vector>

#include "toolkit/smooth/smooth_points.h"

namespace palpate::render {

/// Standard deviations of the points about a smooth surface, mm. Immutable.
class NoiseField {
 public:
  NoiseField() = default;
  /// Parallel; the same for any number of threads and any order of the points. O(n / 64) fits where the
  /// points are noisy. `everywhere`: one for all places.
  NoiseField(const SmoothPoints& points, int threads, bool everywhere = false);

  /// The median over some hundreds of places.
  [[nodiscard]] double median() const noexcept { return median_; }
  /// Around point i, at least the median.
  [[nodiscard]] double at(std::size_t i) const noexcept {
    return around_.empty() ? median_ : static_cast<double>(around_[i / kStride]);
  }

 private:
  static constexpr std::size_t kStride = 64;
  double median_ = 0.0;
  std::vector<float> around_;  ///< of kStride points each, in their order; empty: the same everywhere
};

}  // namespace palpate::render
