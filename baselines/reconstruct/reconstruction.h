// A reconstructed mesh with its costs, and its serialisation. Bytes are little-endian, for the reconstruction
// process and the cache.
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

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include "toolkit/core/bytes.h"

namespace palpate::baselines {

static_assert(std::endian::native == std::endian::little, "arrays are written as they stand in memory");

/// Appends values: numbers and enums as they stand, texts and arrays after their length (8 bytes).
class OutputArchive {
 public:
  static constexpr bool kReads = false;
  template <class T>
  void operator()(const T& value) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  void operator()(std::string_view text) { (*this)(std::span(text)); }
  void operator()(const std::string& text) { (*this)(std::string_view(text)); }
  /// T must have no padding.
  template <class T>
  void operator()(const std::vector<T>& values) {
    (*this)(std::span(values));
  }
  template <class T>
  void operator()(std::span<const T> values) {
    (*this)(static_cast<std::uint64_t>(values.size()));
    bytes_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  /// each(*this, element) for all elements, after their number.
  template <class T, class Each>
  void list(const std::vector<T>& values, const Each& each) {
    (*this)(static_cast<std::uint64_t>(values.size()));
    for (const T& value : values) each(*this, value);
  }
  [[nodiscard]] const std::string& bytes() const noexcept { return bytes_; }
  [[nodiscard]] std::string take() && noexcept { return std::move(bytes_); }

 private:
  std::string bytes_;
};

/// Reads what an OutputArchive wrote, in the same order. Past the end, or at a length beyond it, values
/// become zero or empty and good() stays false.
class InputArchive {
 public:
  static constexpr bool kReads = true;
  explicit InputArchive(std::string_view bytes) : from_(std::as_bytes(std::span(bytes))) {}
  template <class T>
  void operator()(T& value) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    using Raw = std::conditional_t<std::is_same_v<T, bool>, std::uint8_t, T>;
    Raw raw{};
    if (const auto bytes = from_.raw(sizeof raw); !bytes.empty()) std::memcpy(&raw, bytes.data(), sizeof raw);
    value = static_cast<T>(raw);
  }
  template <class T>
  [[nodiscard]] T value() {
    T v{};
    (*this)(v);
    return v;
  }
  void operator()(std::string& text) { array(text, 1); }
  template <class T>
  void operator()(std::vector<T>& values) {
    array(values, sizeof(T));
  }
  template <class T, class Each>
  void list(std::vector<T>& values, const Each& each) {
    for (auto n = value<std::uint64_t>(); n > 0 && good(); --n) each(*this, values.emplace_back());
  }
  [[nodiscard]] bool good() const noexcept { return from_.good(); }
  [[nodiscard]] bool at_end() const noexcept { return good() && from_.left() == 0; }

 private:
  template <class Values>
  void array(Values& values, std::size_t element) {
    const auto count = value<std::uint64_t>();
    values.clear();
    if (count > from_.left() / element) return from_.fail();
    values.resize(count);
    const auto bytes = from_.raw(count * element);
    if (count > 0) std::memcpy(static_cast<void*>(values.data()), bytes.data(), bytes.size());
  }
  ByteReader from_;
};

struct Reconstruction {
  geometry::TriangleMesh mesh;  ///< model frame, mm
  render::PrepareReport made;   ///< phases timed at its making; `bytes` is the mesh's own
  std::size_t peak_bytes = 0;   ///< peak resident memory of the making process; 0: unknown
  int threads = 0;              ///< allowed at its making
  std::string made_on;          ///< date and time, UTC
  bool recorded = false;        ///< from the cache: times are those of `made_on`
};

void write(OutputArchive& to, const Reconstruction& from);
/// An Error for malformed bytes or indices out of range.
[[nodiscard]] Result<Reconstruction> read_reconstruction(InputArchive& from);

/// Positions and raster only: properties do not affect a mesh.
void write(OutputArchive& to, const cloud::Cloud& from);
[[nodiscard]] Result<cloud::Cloud> read_cloud(InputArchive& from);

void write(OutputArchive& to, const Error& from);
[[nodiscard]] Error read_error(InputArchive& from);

/// As "2026-01-31 12:00 UTC".
[[nodiscard]] std::string now_text();

}  // namespace palpate::baselines
