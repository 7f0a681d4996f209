// Little-endian numbers as bytes on every machine. Writers provide enough memory; reading checks every byte.
#pragma once

#include <bit>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <palpate/vec.h>

namespace palpate {

class ByteWriter {
 public:
  explicit ByteWriter(std::span<std::byte> into) noexcept : into_(into) {}
  explicit ByteWriter(std::span<std::uint8_t> into) noexcept : ByteWriter(std::as_writable_bytes(into)) {}

  void u8(std::uint8_t value) noexcept { number(value); }
  void u16(std::uint16_t value) noexcept { number(value); }
  void u32(std::uint32_t value) noexcept { number(value); }
  void u64(std::uint64_t value) noexcept { number(value); }
  void i8(std::int8_t value) noexcept { number(static_cast<std::uint8_t>(value)); }
  void i32(std::int32_t value) noexcept { number(static_cast<std::uint32_t>(value)); }
  void i64(std::int64_t value) noexcept { number(static_cast<std::uint64_t>(value)); }
  void single(float value) noexcept { number(std::bit_cast<std::uint32_t>(value)); }
  void real(double value) noexcept { number(std::bit_cast<std::uint64_t>(value)); }
  void vec(const Vec3& value) noexcept {
    for (int axis = 0; axis < 3; ++axis) real(value[axis]);
  }
  void raw(std::span<const std::byte> bytes) noexcept {
    assert(at_ + bytes.size() <= into_.size());
    if (!bytes.empty()) std::memcpy(into_.data() + at_, bytes.data(), bytes.size());
    at_ += bytes.size();
  }
  void text(std::string_view text) noexcept {
    u32(static_cast<std::uint32_t>(text.size()));
    raw(std::as_bytes(std::span(text)));
  }
  [[nodiscard]] std::size_t size() const noexcept { return at_; }

 private:
  template <class T>
  void number(T value) noexcept {
    static_assert(std::is_unsigned_v<T>);
    assert(at_ + sizeof(T) <= into_.size());
    if constexpr (std::endian::native == std::endian::little) {
      std::memcpy(into_.data() + at_, &value, sizeof(T));
    } else {
      for (std::size_t i = 0; i < sizeof(T); ++i)
        into_[at_ + i] = static_cast<std::byte>((value >> (8 * i)) & 0xFFu);
    }
    at_ += sizeof(T);
  }

  std::span<std::byte> into_;
  std::size_t at_ = 0;
};

/// The writer of `size` bytes that it appends; valid until `bytes` grows again. Allocates, so not for frames.
[[nodiscard]] inline ByteWriter append_to(std::vector<std::byte>& bytes, std::size_t size) {
  bytes.resize(bytes.size() + size);
  return ByteWriter(std::span(bytes).last(size));
}

/// After the end everything reads as 0 and good() is false.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::byte> from) noexcept : from_(from) {}
  explicit ByteReader(std::span<const std::uint8_t> from) noexcept : ByteReader(std::as_bytes(from)) {}

  [[nodiscard]] std::uint8_t u8() noexcept { return number<std::uint8_t>(); }
  [[nodiscard]] std::uint16_t u16() noexcept { return number<std::uint16_t>(); }
  [[nodiscard]] std::uint32_t u32() noexcept { return number<std::uint32_t>(); }
  [[nodiscard]] std::uint64_t u64() noexcept { return number<std::uint64_t>(); }
  [[nodiscard]] std::int8_t i8() noexcept { return static_cast<std::int8_t>(u8()); }
  [[nodiscard]] std::int32_t i32() noexcept { return static_cast<std::int32_t>(u32()); }
  [[nodiscard]] std::int64_t i64() noexcept { return static_cast<std::int64_t>(u64()); }
  [[nodiscard]] float single() noexcept { return std::bit_cast<float>(u32()); }
  [[nodiscard]] double real() noexcept { return std::bit_cast<double>(u64()); }
  [[nodiscard]] Vec3 vec() noexcept {
    const double x = real(), y = real(), z = real();
    return {x, y, z};
  }
  [[nodiscard]] std::span<const std::byte> raw(std::size_t bytes) noexcept {
    if (bytes > left()) {
      fail();
      return {};
    }
    const std::span<const std::byte> got = from_.subspan(at_, bytes);
    at_ += bytes;
    return got;
  }
  [[nodiscard]] std::string text() {
    const std::span<const std::byte> bytes = raw(u32());
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }
  void fail() noexcept {
    good_ = false;
    at_ = from_.size();
  }
  [[nodiscard]] bool good() const noexcept { return good_; }
  [[nodiscard]] std::size_t left() const noexcept { return from_.size() - at_; }
  [[nodiscard]] std::size_t at() const noexcept { return at_; }

 private:
  template <class T>
  T number() noexcept {
    if (left() < sizeof(T)) {
      fail();
      return 0;
    }
    T value = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i)
      value = static_cast<T>(value | static_cast<T>(static_cast<T>(from_[at_ + i]) << (8 * i)));
    at_ += sizeof(T);
    return value;
  }

  std::span<const std::byte> from_;
  std::size_t at_ = 0;
  bool good_ = true;
};

}  // namespace palpate
