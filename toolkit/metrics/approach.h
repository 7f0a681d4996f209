// How near a path comes to the points of models that it may never touch.
#pragma once

#include <cstddef>
#include <limits>
#include <span>

#include "toolkit/core/vec.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/trace.h"

namespace palpate::metrics {

struct Approach {
  double distance_mm = std::numeric_limits<double>::infinity();  ///< to the nearest point
  std::size_t sample = 0;                                        ///< of the path
  std::size_t model = 0;
};

/// The nearest that any sample comes to any point of the models, where they stand at the start. Exact.
/// O(points log points), then little for a path that passes by and O(samples log points) for one among the
/// points.
[[nodiscard]] Approach nearest_approach(const trace::ProbePath& path,
                                        std::span<const render::ModelInput> models);

}  // namespace palpate::metrics
