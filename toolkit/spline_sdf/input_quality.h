// Detects points that no smooth two-sided surface fits.
#pragma once

#include "toolkit/spline_sdf/morton_points.h"

namespace palpate::render {

/// Shares of some hundred sampled places.
struct InputQuality {
  double layered = 0.0;            ///< the points form two layers too close to separate
  double layer_distance_mm = 0.0;  ///< median distance of these layers
  double scattered = 0.0;          ///< the points fill a ball instead of a surface
};

/// `noise`: estimate_noise() of the points, mm. O(1), parallel; independent of the number of threads.
[[nodiscard]] InputQuality assess_input_quality(const MortonPoints& points, double noise, int threads);

}  // namespace palpate::render
