// What takes the lists of corners of a PLY file: polygons, strips of triangles, grids of points. Internal to
// read_ply.cpp.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "toolkit/io/decoding.h"

namespace palpate::io {

// An index as the file has it: whole, else -1, which no face may use.
inline std::int64_t to_index(double value) noexcept {
  constexpr double kEnd = 4294967296.0;  // 2^32: more than any index
  if (!(value >= 0.0) || value >= kEnd) return -1;
  const auto whole = static_cast<std::int64_t>(value);
  return static_cast<double>(whole) == value ? whole : -1;
}

// Takes the triangles of strips out of a list of corners: each corner closes one with the two before it,
// every second one turned, so that all face the same way; -1 ends a strip. A corner that stands twice in a
// triangle is how writers join two strips: no face.
class StripBuilder {
 public:
  explicit StripBuilder(FaceBuilder& faces) noexcept : faces_(faces) {}
  void begin() noexcept { length_ = 0; }
  [[nodiscard]] bool corner(double value) {
    constexpr double kEndOfStrip = -1.0;
    if (value == kEndOfStrip) {
      begin();
      return true;
    }
    const std::int64_t now = to_index(value);
    const bool turned = length_ % 2 != 0;
    if (++length_ > 2 && now != last_ && now != before_ && last_ != before_) {
      faces_.begin();
      if (!faces_.corner(turned ? last_ : before_) || !faces_.corner(turned ? before_ : last_) ||
          !faces_.corner(now))
        return false;
      faces_.end();
    }
    before_ = last_;
    last_ = now;
    return true;
  }
  void end() const noexcept {}
  [[nodiscard]] Error error() const { return faces_.too_many(); }

 private:
  FaceBuilder& faces_;
  std::int64_t before_ = 0, last_ = 0;
  std::uint64_t length_ = 0;
};

// A polygon is its list.
struct PolygonBuilder {
  FaceBuilder& faces;
  void begin() noexcept { faces.begin(); }
  [[nodiscard]] bool corner(double value) { return faces.corner(to_index(value)); }
  void end() { faces.end(); }
  [[nodiscard]] Error error() const { return faces.too_many(); }
};

// Of a raster's positions, row by row, who stands there: a list of one point or none.
class GridBuilder {
 public:
  static constexpr std::uint32_t kNowhere = 0xFFFFFFFFu;
  explicit GridBuilder(std::size_t points) : position_of_(points, kNowhere) {}
  void begin() noexcept { at_position_ = 0; }
  [[nodiscard]] bool corner(double value) noexcept {
    const std::int64_t index = to_index(value);
    const auto point = static_cast<std::size_t>(index);
    once_ = once_ && at_position_++ == 0 && index >= 0 && point < position_of_.size() &&
            position_of_[point] == kNowhere;
    if (once_) {
      position_of_[point] = position_;
      ++placed_;
    }
    return true;  // a grid that tells nothing of its points takes nothing from them
  }
  void end() noexcept { ++position_; }
  [[nodiscard]] static Error error() { return {}; }
  // Nobody stands at two positions, no two at one, and everyone somewhere.
  [[nodiscard]] bool complete() const noexcept { return once_ && placed_ == position_of_.size(); }
  [[nodiscard]] std::vector<std::uint32_t> take() noexcept { return std::move(position_of_); }

 private:
  std::vector<std::uint32_t> position_of_;
  std::uint32_t position_ = 0;
  std::size_t at_position_ = 0, placed_ = 0;
  bool once_ = true;
};

}  // namespace palpate::io
