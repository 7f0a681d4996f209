// SHA-256 (FIPS 180-4, by Nettle): checksums of downloads, and by which an image of firmware is known.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "toolkit/core/result.h"

namespace palpate {

/// Sixty-four hexadecimal digits: of bytes in memory.
[[nodiscard]] std::string sha256_of(std::span<const std::byte> data) noexcept;
/// Of a whole file, read in pieces.
[[nodiscard]] Result<std::string> sha256_of_file(const std::string& path);

}  // namespace palpate
