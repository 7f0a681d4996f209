// Whether points lie all around a place, or end there: by the widest angle in which there is none, which does
// not ask how dense they are on either side.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace palpate::render {

/// Directions along a tangent plane in which points were seen.
class Surround {
 public:
  void add(double a, double b) noexcept {
    const double turn = std::atan2(b, a) * (0.5 / std::numbers::pi) + 0.5;
    seen_ |= std::uint64_t{1} << std::min(static_cast<int>(turn * kSectors), kSectors - 1);
  }
  /// The widest angle without a point, in turns, to 1/48 and rounded down.
  [[nodiscard]] double widest() const noexcept {
    if (seen_ == 0) return 1.0;
    int run = 0, most = 0;
    for (int i = 0; i < 2 * kSectors; ++i) {
      run = ((seen_ >> (i % kSectors)) & 1u) != 0 ? 0 : run + 1;
      most = std::max(most, run);
    }
    return static_cast<double>(most) / kSectors;
  }
  /// The points end here: at a straight border half a turn is empty, and what a sector more on either side
  /// takes of it.
  [[nodiscard]] bool open() const noexcept { return widest() >= 0.5 - 2.0 / kSectors; }

 private:
  static constexpr int kSectors = 48;
  std::uint64_t seen_ = 0;
};

/// A point tells of a place within so many of its own spacings.
inline constexpr double kTellsSpacings = 4.0;

}  // namespace palpate::render
