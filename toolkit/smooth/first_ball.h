// The points that a patch begins with: as few as tell a quadric, on all sides of the middle where there are
// any.
#pragma once

#include "toolkit/smooth/quadric.h"

namespace palpate::render {

/// The radius of a first ball, in spacings: 15 points, twice what a quadric needs and a few more.
inline constexpr double kFirstRadius = 2.2;

/// The points around point i: enough of them, in more than one scan line, and over a step of density beyond
/// it. Its radius over kFirstRadius is the spacing there. False where the point stands alone.
[[nodiscard]] bool gather_first(const SmoothPoints& points, std::size_t i, Ball& ball);

/// The noise at single places. Belongs to one thread.
class NoiseProbe {
 public:
  /// Of the points about a quadric around point i, mm, and their spacing there; less than 0 where the point
  /// stands alone.
  [[nodiscard]] double noise_at(const SmoothPoints& points, std::size_t i, double& spacing);

 private:
  Ball ball_;
};

/// The noise of the points about a smooth surface, mm: the median over some hundreds of places. O(1).
[[nodiscard]] double measure_noise(const SmoothPoints& points, int threads);

}  // namespace palpate::render
