// Limits on the size of a cloud.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

namespace palpate::cloud {

/// Most points of a cloud (checked by build_cloud()): twice an index plus one, which piece orientation uses
/// for point and side, fits 32 bits.
inline constexpr std::size_t kMaxCloudPoints = (std::size_t{1} << 31) - 1;
static_assert(2 * (kMaxCloudPoints - 1) + 1 <= std::numeric_limits<std::uint32_t>::max());

/// Mesh indices are 32 bits, and a hundred million points with their mesh fill a desktop's memory.
inline constexpr double kMaxGeneratedPoints = 1e8;

}  // namespace palpate::cloud
