// Whether points lie all around a place, or end there: by the widest angle in which there is none, which does
// not ask how dense they are on either side.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace palpate::render {

/// The angle of a direction in turns from 0 to 1, to 0.0008 of them; 0 for none.
[[nodiscard]] inline double turn_of(double a, double b) noexcept {
  const auto eighth = [](double tangent) { return tangent * (0.1547623 - 0.0305418 * tangent * tangent); };
  const double x = std::abs(a), y = std::abs(b);
  if (!(x + y > 0.0)) return 0.0;
  double turn = x > y ? eighth(y / x) : 0.25 - eighth(x / y);
  if (a < 0.0) turn = 0.5 - turn;
  return b < 0.0 ? 1.0 - turn : turn;
}

/// Where in a disc there are points: in up to 64 cells of like area, as many as there are points to fill
/// them.
class Filled {
 public:
  Filled() = default;
  /// `points`: of the disc, at most.
  explicit Filled(std::size_t points)
      : sectors_(points < kFew    ? 6
                 : points < kMany ? 8
                                  : 16),
        rings_(points < kFew    ? 2
               : points < kMany ? 3
                                : 4) {}
  /// (a, b) in radii.
  void add(double a, double b) noexcept {
    const double sq = a * a + b * b;
    if (sq < 1.0) filled_ |= bit(sector(a, b), static_cast<int>(sq * rings_));
  }
  /// Whether a place has points on all its sides, beyond doubt: in its cell, and in those beside and outside.
  [[nodiscard]] bool around(double a, double b) const noexcept {
    const double sq = a * a + b * b;
    const int ring = static_cast<int>(std::min(sq, 1.0) * rings_);
    if (ring + 1 >= rings_) return false;
    const int at = sector(a, b);
    std::uint64_t asked = 0;
    for (int side = sectors_ - 1; side <= sectors_ + 1; ++side)
      asked |= bit((at + side) % sectors_, ring) | bit((at + side) % sectors_, ring + 1);
    return (filled_ & asked) == asked;
  }

 private:
  /// Six points a cell are none in one of 400.
  static constexpr std::size_t kFew = 8 * 3 * 6, kMany = 16 * 4 * 6;
  [[nodiscard]] int sector(double a, double b) const noexcept {
    return std::min(static_cast<int>(turn_of(a, b) * sectors_), sectors_ - 1);
  }
  [[nodiscard]] std::uint64_t bit(int sector, int ring) const noexcept {
    return std::uint64_t{1} << (ring * sectors_ + sector);
  }
  std::uint64_t filled_ = 0;
  int sectors_ = 6, rings_ = 2;
};

/// Directions along a tangent plane in which points were seen.
class Surround {
 public:
  void add(double a, double b) noexcept {
    seen_ |= std::uint64_t{1} << std::min(static_cast<int>(turn_of(a, b) * kSectors), kSectors - 1);
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
