// Sums over points for quadric fits: four points at a time with AVX2, the same bits without.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include <palpate/vec.h>

namespace palpate::spline_sdf {

/// The fit's frame; lengths in ball radii.
struct FitFrame {
  Vec3 shift = Vec3::Zero();                                  ///< from the ball's centre, mm
  Vec3 u = Vec3::Zero(), v = Vec3::Zero(), w = Vec3::Zero();  ///< divided by the radius, 1/mm
};
/// The height over (u, v): 1, u, v, u^2, uv, v^2.
using FitHeight = std::array<double, 6>;

/// Moments u^i v^j up to fourth order, and with w up to second order.
struct FitMoments {
  std::array<double, 15> m;
  std::array<double, 6> r;
};

/// A ball's points in memory.
struct FitLanes {
  const double *x, *y, *z, *real;
  double *u, *v, *w, *off;
  std::size_t count;  ///< a multiple of FitPoints::kSimdWidth
};

/// A ball's points for fitting, padded by up to three empty slots. Scratch memory for one thread.
class FitPoints {
 public:
  static constexpr std::size_t kSimdWidth = 4;
  /// O(points), like the other members.
  void take(const std::vector<Vec3>& away);
  [[nodiscard]] std::size_t size() const noexcept { return count_; }
  /// Moments weighted by 1 - u^2 - v^2 and, if `per_scale` is not 0, by (1 + x^2)^-2 with x = per_scale times
  /// the residual from `height`. Leaves (u, v, w) for median_residual().
  void moments(const FitFrame& frame, const FitHeight& height, double per_scale, FitMoments& out);
  /// The median absolute residual from a height; the upper one for an even count.
  [[nodiscard]] double median_residual(const FitHeight& height);
  /// The sum of (1 + x^2)^-2.
  [[nodiscard]] double weights(const FitFrame& frame, const FitHeight& height, double per_scale);

 private:
  [[nodiscard]] FitLanes lanes() noexcept;
  /// The residual of rank `rank`, within [low, high).
  [[nodiscard]] double of_rank_between(double low, double high, std::size_t rank);

  std::size_t count_ = 0;
  std::vector<double> x_, y_, z_, real_;  ///< real: 1, or 0 for padding
  std::vector<double> u_, v_, w_, off_;
  std::vector<double> between_;  ///< scratch of the median
};

}  // namespace palpate::spline_sdf
