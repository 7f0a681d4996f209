// Fewer points of a cloud, chosen at random.
#pragma once

#include <cstdint>

#include "toolkit/cloud/cloud.h"

namespace palpate::cloud {

/// `count` of the points, each equally likely, in their order; without properties and raster. All of them
/// where there are no more. The same for the same seed. O(n).
[[nodiscard]] Cloud sample_of(const Cloud& cloud, std::size_t count, std::uint64_t seed);

}  // namespace palpate::cloud
