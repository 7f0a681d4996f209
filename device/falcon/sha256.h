// SHA-256 (FIPS 180-4): by which an image of firmware is known. Small and plain, for kilobytes.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace palpate::device {

/// 64 hexadecimal digits. O(bytes).
[[nodiscard]] std::string sha256_hex(std::span<const std::uint8_t> bytes);

}  // namespace palpate::device
