// SHA-256 (FIPS 180-4): checksums of downloads, and by which an image of firmware is known.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "toolkit/core/result.h"

namespace palpate {

class Sha256 {
 public:
  void bytes(std::span<const std::byte> data) noexcept;
  /// Sixty-four hexadecimal digits. Ends the computation.
  [[nodiscard]] std::string finish() noexcept;

 private:
  void block(const std::uint8_t* data) noexcept;

  std::array<std::uint32_t, 8> state_ = {0x6a09e667u, 0xbb67ae85u, 0x3c6ef372u, 0xa54ff53au,
                                         0x510e527fu, 0x9b05688cu, 0x1f83d9abu, 0x5be0cd19u};
  std::array<std::uint8_t, 64> buffer_{};
  std::size_t buffered_ = 0;
  std::uint64_t total_ = 0;
};

/// Of bytes in memory.
[[nodiscard]] std::string sha256_of(std::span<const std::byte> data) noexcept;
/// Of a whole file, read in pieces.
[[nodiscard]] Result<std::string> sha256_of_file(const std::string& path);

}  // namespace palpate
