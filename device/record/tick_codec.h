// A tick as the bytes that stand in a recording (docs/recordings.md).
#pragma once

#include <array>
#include <span>

#include "device/record/bytes.h"
#include "device/record/recorded_tick.h"

namespace palpate::device {

// The longest tick: what is always there, a raw packet, and the most tracks with the most calls.
inline constexpr std::size_t kVecBytes = 3 * sizeof(double);
inline constexpr std::size_t kMostCallBytes = 1 + kVecBytes + sizeof(double);
inline constexpr std::size_t kMostTrackBytes =
    2 + 1 + 8 + 1 + 4 + 2 * kVecBytes + 1 + kMostCalls * kMostCallBytes;
inline constexpr std::size_t kMostBytesATick = 4 + 6 * 8 + 4 + 3 * kVecBytes + RawPacket::kMost + 8 +
                                               (2 + 8 + 2) + 1 + RecordedTick::kMostTracks * kMostTrackBytes;

/// The bytes it took, at most kMostBytesATick, which `into` must have room for. What a well-behaved tick does
/// not need is left out: 200 bytes for one renderer in contact. No allocation.
[[nodiscard]] std::size_t encode(const RecordedTick& tick, std::span<std::byte> into) noexcept;

/// Where the calls of a decoded tick stand.
using CallStorage = std::array<RendererCall, RecordedTick::kMostTracks * kMostCalls>;

/// What may stand in a tick besides what every recording allows.
struct TickBounds {
  std::size_t renderers = 0;  ///< of the table
  std::size_t decisions = 1;
};

/// The next tick; its calls are put into `calls`, which must outlive it. False: it is no tick.
[[nodiscard]] bool decode(ByteReader& from, const TickBounds& bounds, CallStorage& calls, RecordedTick& tick);

}  // namespace palpate::device
