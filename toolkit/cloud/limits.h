// How large a cloud may be.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

namespace palpate::cloud {

/// Points of one cloud, at most; build_cloud() refuses more. So twice an index and one more, in which the
/// orientation of pieces keeps a point and a side, fits into 32 bits.
inline constexpr std::size_t kMaxCloudPoints = (std::size_t{1} << 31) - 1;
static_assert(2 * (kMaxCloudPoints - 1) + 1 <= std::numeric_limits<std::uint32_t>::max());

}  // namespace palpate::cloud
