// The sums over points that a quadric is fitted by: four points at once where the machine can, with the same
// bits where it cannot.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "toolkit/core/vec.h"

namespace palpate::render {

/// Where the fit stands: lengths in radii of the ball.
struct FitFrame {
  Vec3 shift = Vec3::Zero();                                  ///< from the ball's centre, mm
  Vec3 u = Vec3::Zero(), v = Vec3::Zero(), w = Vec3::Zero();  ///< over the radius, 1/mm
};
/// The height over (u, v): 1, u, v, u^2, uv, v^2.
using FitHeight = std::array<double, 6>;

/// Moments u^i v^j up to the fourth order, and with w up to the second.
struct FitMoments {
  std::array<double, 15> m;
  std::array<double, 6> r;
};

/// Where the points of a ball are in memory.
struct FitLanes {
  const double *x, *y, *z, *real;
  double *u, *v, *w, *off;
  std::size_t count;  ///< a multiple of FitPoints::kAtOnce
};

/// A ball's points for its fits; up to three places after the last one are no points. Scratch: belongs to one
/// thread.
class FitPoints {
 public:
  static constexpr std::size_t kAtOnce = 4;
  /// O(points), as all of these.
  void take(const std::vector<Vec3>& away);
  [[nodiscard]] std::size_t size() const noexcept { return count_; }
  /// Weighed by 1 - u^2 - v^2, and where `per_scale` is not 0 by (1 + x^2)^-2 of the residual x from
  /// `height`, times per_scale. Leaves (u, v, w) for median_residual().
  void moments(const FitFrame& frame, const FitHeight& height, double per_scale, FitMoments& out);
  /// The median of what the points are off a height, unsigned; of an even number the greater one.
  [[nodiscard]] double median_residual(const FitHeight& height);
  /// The sum of (1 + x^2)^-2.
  [[nodiscard]] double weights(const FitFrame& frame, const FitHeight& height, double per_scale);

 private:
  [[nodiscard]] FitLanes lanes() noexcept;
  /// Of the residuals from `low` to below `high` that with `rank` less ones.
  [[nodiscard]] double of_rank_between(double low, double high, std::size_t rank);

  std::size_t count_ = 0;
  std::vector<double> x_, y_, z_, real_;  ///< real: 1, or 0 where there is no point
  std::vector<double> u_, v_, w_, off_;
  std::vector<double> between_;  ///< scratch of the median
};

}  // namespace palpate::render
