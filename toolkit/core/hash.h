// FNV-1a, 64 bits (Fowler, Noll, Vo): the hash of traces and inputs. Not for security.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace palpate {

class Hash64 {
 public:
  static constexpr const char* kName = "fnv1a64";

  void bytes(std::span<const std::byte> data) noexcept {
    for (const std::byte b : data) byte(static_cast<std::uint8_t>(b));
  }
  void byte(std::uint8_t b) noexcept {
    state_ ^= b;
    state_ *= 0x100000001B3u;
  }
  /// Eight bytes, least significant first on every machine.
  void u64(std::uint64_t value) noexcept {
    for (int i = 0; i < 8; ++i) byte(static_cast<std::uint8_t>(value >> (8 * i)));
  }
  /// The bits of a double; -0 counts as 0 and every NaN as one NaN, which differ in no way a hand could feel.
  void real(double value) noexcept {
    u64(value != value ? 0x7FF8000000000000u : std::bit_cast<std::uint64_t>(value == 0.0 ? 0.0 : value));
  }
  [[nodiscard]] std::uint64_t value() const noexcept { return state_; }
  /// Sixteen hexadecimal digits.
  [[nodiscard]] std::string hex() const {
    static constexpr char kDigits[] = "0123456789abcdef";
    std::string text(16, '0');
    for (int i = 0; i < 16; ++i) text[static_cast<std::size_t>(15 - i)] = kDigits[(state_ >> (4 * i)) & 15u];
    return text;
  }

 private:
  std::uint64_t state_ = 0xCBF29CE484222325u;
};

}  // namespace palpate
