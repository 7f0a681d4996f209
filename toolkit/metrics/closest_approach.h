// The smallest distance of a path to models' points.
#pragma once

#include <cstddef>
#include <limits>
#include <span>

#include <palpate/renderer.h>
#include <palpate/trace.h>
#include <palpate/vec.h>

namespace palpate::metrics {

struct ClosestApproach {
  double distance_mm = std::numeric_limits<double>::infinity();  ///< to the nearest point
  std::size_t sample = 0;                                        ///< of the path
  std::size_t model = 0;
};

/// Over all samples and points, models at their start poses. Exact. O(points log points), then little for a
/// path that passes by, O(samples log points) among the points.
[[nodiscard]] ClosestApproach closest_approach(const trace::ProbePath& path,
                                               std::span<const render::ModelInput> models);

}  // namespace palpate::metrics
