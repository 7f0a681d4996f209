// A picture of the surface that is felt: a slice with the points, the truth, and where each renderer's god
// object is when it is touched along a row of places.
#pragma once

#include <string>
#include <vector>

#include "experiments/benchmarks/felt_surface/trial.h"
#include "toolkit/core/result.h"
#include "toolkit/render/registry.h"

namespace palpate::felt {

/// `name` is edge, hole, thin or noise. Writes an SVG file.
[[nodiscard]] Status draw_slice(const std::string& name, const std::vector<Tried>& renderers,
                                const render::Registry& registry, const std::string& file);

}  // namespace palpate::felt
