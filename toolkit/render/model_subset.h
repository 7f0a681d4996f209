// Functions on a scene's models before preparation: their box, and parts of a model.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <palpate/aabb.h>
#include <palpate/renderer.h>

namespace palpate::render {

/// The box around all models at their start poses; world, mm.
[[nodiscard]] geometry::Aabb box_of(const std::vector<ModelInput>& models);

/// The model reduced to some of its points with their surface properties. Drops the faces, which use all
/// points. `raster` describes the subset.
[[nodiscard]] ModelInput subset_of(const ModelInput& model, std::span<const std::uint32_t> of,
                                   const std::optional<cloud::ScanRaster>& raster = std::nullopt);

}  // namespace palpate::render
