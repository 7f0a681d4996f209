// Draws a slice of the rendered surface: points, truth, and each renderer's god objects along a row of
// touches.
#pragma once

#include <string>
#include <vector>

#include <palpate/registry.h>
#include <palpate/result.h>
#include "experiments/benchmarks/felt_surface/trial.h"

namespace palpate::felt {

/// `name`: edge, hole, thin or noise. Writes an SVG file.
[[nodiscard]] Status draw_slice(const std::string& name, const std::vector<Tried>& renderers,
                                const render::Registry& registry, const std::string& file);

}  // namespace palpate::felt
