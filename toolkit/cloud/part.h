// A part of a cloud, by the numbers of its points.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/cloud/cloud.h"

namespace palpate::cloud {

/// The values at these numbers, in their order; none of none.
[[nodiscard]] std::vector<float> taken(const std::vector<float>& values, std::span<const std::uint32_t> of);

/// These points in their order, exactly as stored, their properties with them; no raster. Each number is one
/// of the cloud's.
[[nodiscard]] Cloud part_of(const Cloud& cloud, std::span<const std::uint32_t> of);

}  // namespace palpate::cloud
