// Numbers of the layout of a file of surfaces, which its reader and its writer must agree on: a head, the
// tiles of all surfaces back to back, the index, an end that says where the index is.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "toolkit/core/hash.h"

namespace palpate::render::surface_layout {

inline constexpr std::array<char, 8> kMagic{'P', 'A', 'L', 'P', 'S', 'U', 'R', 'F'};
inline constexpr std::uint32_t kVersion = 1;
inline constexpr std::size_t kFileHeadBytes = 16;  // magic, version, a spare number
inline constexpr std::size_t kFileEndBytes = 32;   // the index's offset, bytes and checksum; the magic
inline constexpr std::size_t kTileRowBytes =
    40;  // code, depth, a spare number, offset, checksum, bytes, bricks
inline constexpr std::size_t kGeometryBytes = 200;  // of a surface, with room for more numbers
inline constexpr std::size_t kPartBytes = 24;

/// Of the index, and of each tile in it.
[[nodiscard]] inline std::uint64_t checksum_of(std::span<const std::byte> bytes) noexcept {
  Hash64 hash;
  hash.bytes(bytes);
  return hash.value();
}

}  // namespace palpate::render::surface_layout
