// Hashes: FNV-1a (Fowler, Noll, Vo) for traces and inputs, not for security; SHA-256 for downloads and
// firmware.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <palpate/result.h>

namespace palpate {

/// 2^64 over the golden section, odd: multiplication spreads consecutive numbers over 64 bits (Fibonacci
/// hashing).
inline constexpr std::uint64_t kGolden64 = 0x9E3779B97F4A7C15u;
/// Two more odd numbers, those of splitmix64's finaliser (Steele, Lea and Flood 2014).
inline constexpr std::uint64_t kMixFirst64 = 0xBF58476D1CE4E5B9u, kMixSecond64 = 0x94D049BB133111EBu;

/// The finaliser of splitmix64: every bit depends on all.
[[nodiscard]] constexpr std::uint64_t mixed64(std::uint64_t h) noexcept {
  h = (h ^ (h >> 30)) * kMixFirst64;
  h = (h ^ (h >> 27)) * kMixSecond64;
  return h ^ (h >> 31);
}

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
  /// Eight bytes, little-endian on every machine.
  void u64(std::uint64_t value) noexcept {
    for (int i = 0; i < 8; ++i) byte(static_cast<std::uint8_t>(value >> (8 * i)));
  }
  /// The bits of a double, with -0 as 0 and one NaN, whose variants feel the same.
  void real(double value) noexcept {
    u64(value != value ? 0x7FF8000000000000u : std::bit_cast<std::uint64_t>(value == 0.0 ? 0.0 : value));
  }
  [[nodiscard]] std::uint64_t value() const noexcept { return state_; }
  /// Sixteen hexadecimal digits.
  [[nodiscard]] std::string hex() const;

 private:
  std::uint64_t state_ = 0xCBF29CE484222325u;
};

/// Hashes large arrays in memory, eight bytes at a time; ten times as fast as Hash64. Never written to a
/// file.
class ContentHash {
 public:
  void u64(std::uint64_t value) noexcept {
    state_ = (state_ ^ value) * kGolden64;
    state_ ^= state_ >> 32;
  }
  void text(std::string_view text) noexcept { bytes(std::as_bytes(std::span(text))); }
  template <class T>
  void values(const std::vector<T>& values) noexcept {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes(std::as_bytes(std::span(values)));
  }
  /// Includes the length, so adjacent arrays stay distinct.
  void bytes(std::span<const std::byte> data) noexcept {
    u64(data.size());
    for (; data.size() >= sizeof(std::uint64_t); data = data.subspan(sizeof(std::uint64_t))) {
      std::uint64_t word;
      std::memcpy(&word, data.data(), sizeof(word));
      u64(word);
    }
    std::uint64_t rest = 0;
    if (!data.empty()) std::memcpy(&rest, data.data(), data.size());
    u64(rest);
  }
  [[nodiscard]] std::uint64_t value() const noexcept { return state_; }

 private:
  std::uint64_t state_ = kGolden64;
};

/// SHA-256 (FIPS 180-4, by Nettle) of bytes in memory; sixty-four hexadecimal digits.
[[nodiscard]] std::string sha256_of(std::span<const std::byte> data) noexcept;
/// Of a file, read in pieces.
[[nodiscard]] Result<std::string> sha256_of_file(const std::string& path);

}  // namespace palpate
