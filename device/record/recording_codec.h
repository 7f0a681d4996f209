// Internal to recordings: encodes and decodes header, renderers, notes and close.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "device/record/recording_header.h"
#include "toolkit/core/bytes.h"

namespace palpate::device {

struct RecordingClose {
  std::uint64_t ticks = 0, written = 0, lost = 0;
  std::string reason;
};

[[nodiscard]] std::vector<std::byte> encode(const RecordingHeader& header);
[[nodiscard]] std::vector<std::byte> encode(std::uint16_t index, const RecordedRenderer& renderer);
[[nodiscard]] std::vector<std::byte> encode_note(const std::string& text);
[[nodiscard]] std::vector<std::byte> encode(const RecordingClose& close);

/// False: malformed.
[[nodiscard]] bool decode(std::span<const std::byte> bytes, RecordingHeader& header);
[[nodiscard]] bool decode(std::span<const std::byte> bytes, std::uint16_t& index, RecordedRenderer& renderer);
[[nodiscard]] bool decode_note(std::span<const std::byte> bytes, std::string& text);
[[nodiscard]] bool decode(std::span<const std::byte> bytes, RecordingClose& close);

// Encodes and decodes a tick as bytes in a recording (docs/reference/documents.md).

// The longest tick: fixed part, raw packet, most tracks with most calls.
inline constexpr std::size_t kVecBytes = 3 * sizeof(double);
inline constexpr std::size_t kMaxCallBytes = 1 + kVecBytes + sizeof(double);
inline constexpr std::size_t kMaxTrackBytes =
    2 + 1 + 8 + 1 + 4 + 2 * kVecBytes + 1 + kMaxCalls * kMaxCallBytes;
inline constexpr std::size_t kMaxBytesATick = 4 + 6 * 8 + 4 + 3 * kVecBytes + RawPacket::kMost + 8 +
                                              (2 + 8 + 2) + 1 + RecordedTick::kMaxTracks * kMaxTrackBytes;

/// Returns the bytes written, at most kMaxBytesATick, for which `into` must have room. Omits default values:
/// 200 bytes for one renderer in contact. No allocation.
[[nodiscard]] std::size_t encode(const RecordedTick& tick, std::span<std::byte> into) noexcept;

using CallStorage = std::array<RendererCall, RecordedTick::kMaxTracks * kMaxCalls>;

/// Bounds on a tick beyond those of every recording.
struct TickBounds {
  std::size_t renderers = 0;
  std::size_t decisions = 1;
};

/// Decodes the next tick; its calls go to `calls`, which must outlive the tick. False: malformed.
[[nodiscard]] bool decode(ByteReader& from, const TickBounds& bounds, CallStorage& calls, RecordedTick& tick);

}  // namespace palpate::device
