// What points may be that no smooth surface with two sides follows, asked of the points themselves.
#pragma once

#include "toolkit/smooth/smooth_points.h"

namespace palpate::render {

/// Shares of some hundreds of places.
struct PointDoubts {
  double layered = 0.0;    ///< where the points lie in two layers, too near to each other to be told apart
  double layers_mm = 0.0;  ///< how far these are from each other, the middle of them
  double scattered = 0.0;  ///< where the points are anywhere in a ball rather than on a surface
};

/// `noise`: measure_noise() of the points, mm. O(1), parallel; the same for any number of threads.
[[nodiscard]] PointDoubts find_doubts(const SmoothPoints& points, double noise, int threads);

}  // namespace palpate::render
