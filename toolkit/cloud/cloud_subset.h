// Subsets of a cloud by point index.
#pragma once

#include <palpate/cloud.h>
#include <cstdint>
#include <span>
#include <vector>

namespace palpate::cloud {

/// The values at these indices, in their order; empty for an empty array.
[[nodiscard]] std::vector<float> taken(const std::vector<float>& values, std::span<const std::uint32_t> of);

/// These points in their order, as stored, with properties and without raster. Indices must be valid.
[[nodiscard]] Cloud subset_of(const Cloud& cloud, std::span<const std::uint32_t> of);

/// `count` points chosen uniformly, in their order, without properties and raster; all if there are no more.
/// Deterministic per seed. O(n).
[[nodiscard]] Cloud random_subset(const Cloud& cloud, std::size_t count, std::uint64_t seed);

}  // namespace palpate::cloud
