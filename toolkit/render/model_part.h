// Models of a scene as a whole and in part, before any renderer has them.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "toolkit/geometry/aabb.h"
#include "toolkit/render/renderer.h"

namespace palpate::render {

/// Around all models where they are at the start; world, mm.
[[nodiscard]] geometry::Aabb box_of(const std::vector<ModelInput>& models);

/// The model with these of its points alone, and what its surface says of them. Not its faces: they are of
/// all points. `raster`: what these points are a full raster of.
[[nodiscard]] ModelInput part_of(const ModelInput& model, std::span<const std::uint32_t> of,
                                 const std::optional<cloud::ScanRaster>& raster = std::nullopt);

}  // namespace palpate::render
