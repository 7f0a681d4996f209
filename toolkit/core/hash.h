// Hash64 is FNV-1a (Fowler, Noll, Vo): the hash of traces and inputs. Not for security.
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

namespace palpate {

/// 2^64 over the golden section, odd: multiplying by it spreads consecutive numbers over all 64 bits
/// (Fibonacci hashing).
inline constexpr std::uint64_t kGolden64 = 0x9E3779B97F4A7C15u;

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

/// What tells large arrays apart in memory, eight bytes at a time; ten times as fast as Hash64. Never written
/// to a file.
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
  /// The length belongs to it, so that two arrays never run into one.
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

}  // namespace palpate
