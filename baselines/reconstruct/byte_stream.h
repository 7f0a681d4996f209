// Values as bytes and back, least significant first: what goes between a reconstruction's process and ours,
// and into the cache.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace palpate::baselines {

static_assert(std::endian::native == std::endian::little, "arrays are written as they stand in memory");

class ByteWriter {
 public:
  template <class T>
  void value(const T& v) {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&v), sizeof v);
  }
  void text(std::string_view t) {
    value(static_cast<std::uint64_t>(t.size()));
    bytes_.append(t);
  }
  /// T without padding.
  template <class T>
  void array(const std::vector<T>& values) {
    value(static_cast<std::uint64_t>(values.size()));
    bytes_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  [[nodiscard]] const std::string& bytes() const noexcept { return bytes_; }
  [[nodiscard]] std::string take() && noexcept { return std::move(bytes_); }

 private:
  std::string bytes_;
};

/// Reads what ByteWriter wrote. Past the end, or where a length is longer than what is left, every read gives
/// zero or nothing and good() turns false for ever.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : left_(bytes) {}
  template <class T>
  [[nodiscard]] T value() {
    static_assert(std::is_trivially_copyable_v<T>);
    T v{};
    if (take(sizeof v)) std::memcpy(&v, taken_.data(), sizeof v);
    return v;
  }
  [[nodiscard]] std::string text() {
    return take(value<std::uint64_t>()) ? std::string(taken_) : std::string();
  }
  template <class T>
  [[nodiscard]] std::vector<T> array() {
    const auto count = value<std::uint64_t>();
    std::vector<T> values;
    if (count > left_.size() / sizeof(T) || !take(count * sizeof(T))) {
      good_ = false;
      return values;
    }
    values.resize(count);
    if (count > 0) std::memcpy(static_cast<void*>(values.data()), taken_.data(), taken_.size());
    return values;
  }
  [[nodiscard]] bool good() const noexcept { return good_; }
  [[nodiscard]] bool at_end() const noexcept { return good_ && left_.empty(); }

 private:
  bool take(std::uint64_t size) {
    good_ = good_ && size <= left_.size();
    if (!good_) return false;
    taken_ = left_.substr(0, size);
    left_.remove_prefix(size);
    return true;
  }

  std::string_view left_, taken_;
  bool good_ = true;
};

}  // namespace palpate::baselines
