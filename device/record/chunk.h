// Internal to recordings: what stands around every part of a file, so that a damaged or missing part is seen
// and the others are still found. A file is kFileMark, the version, and chunks.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "device/record/bytes.h"

namespace palpate::device {

/// The line ends notice a copy that was made as text.
inline constexpr std::string_view kFileMark = "PALREC\r\n";
inline constexpr std::size_t kFileHeadBytes = 16;  ///< mark, version, four zeros

enum class ChunkKind : std::uint32_t { kHeader = 1, kRenderer, kTicks, kNote, kEnd };

struct ChunkHead {
  static constexpr std::uint32_t kMark = 0x4B4E4843;  // "CHNK"
  static constexpr std::size_t kBytes = 48;

  ChunkKind kind = ChunkKind::kTicks;
  std::uint64_t number = 0;  ///< counted from 0, in the order of the file
  std::uint32_t payload_bytes = 0;
  std::uint32_t ticks = 0;         ///< in a chunk of ticks
  std::int64_t t_ns = 0;           ///< of the first tick; else 0
  std::uint64_t payload_hash = 0;  ///< FNV-1a, 64 bits
};

/// Longer than any chunk that is written: a chunk of ticks is closed at half of it.
inline constexpr std::size_t kMostPayloadBytes = std::size_t{2} << 20;
inline constexpr std::size_t kFullPayloadBytes = kMostPayloadBytes / 2;

/// FNV-1a. A change within one byte is always found: every step of the hash is one to one.
[[nodiscard]] std::uint64_t hash_of(std::span<const std::byte> bytes) noexcept;

/// The head as bytes; its last eight are the hash of those before.
[[nodiscard]] std::array<std::byte, ChunkHead::kBytes> encode(const ChunkHead& head) noexcept;
/// Nothing where these are not the bytes of a head.
[[nodiscard]] std::optional<ChunkHead> decode_head(std::span<const std::byte> bytes) noexcept;

}  // namespace palpate::device
