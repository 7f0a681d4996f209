// Whether points lie all around a place, or end there: by the widest angle in which there is none, which does
// not ask how dense they are on either side.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace palpate::render {

/// Directions along a tangent plane in which points were seen.
class Surround {
 public:
  void add(double a, double b) noexcept {
    const double x = std::abs(a), y = std::abs(b);
    if (!(x + y > 0.0)) return;
    double turn = x > y ? eighth(y / x) : 0.25 - eighth(x / y);
    if (a < 0.0) turn = 0.5 - turn;
    if (b < 0.0) turn = 1.0 - turn;
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
  /// The angle of a tangent up to one, in turns, to 0.0008 of them: a 25th of a sector.
  static double eighth(double tangent) noexcept {
    return tangent * (0.1547623 - 0.0305418 * tangent * tangent);
  }

  static constexpr int kSectors = 48;
  std::uint64_t seen_ = 0;
};

/// A point tells of a place within so many of its own spacings.
inline constexpr double kTellsSpacings = 4.0;

}  // namespace palpate::render
