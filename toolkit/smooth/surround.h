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

/// Where in a disc there are points: in the cells of a square around it, up to 8 by 8, as many as there are
/// points to fill them.
class Filled {
 public:
  Filled() = default;
  /// `points`: of the disc, at most.
  explicit Filled(std::size_t points) {
    while (cells_ < kMostCells &&
           kPointsPerCell * (cells_ + 1) * (cells_ + 1) <= kDiscShare * static_cast<double>(points))
      ++cells_;
  }
  /// (a, b) in radii.
  void add(double a, double b) noexcept {
    const int x = cell(a), y = cell(b);
    if (x >= 0 && x < cells_ && y >= 0 && y < cells_) filled_ |= bit(x, y);
  }
  /// Whether there is any place of which around() may be true: it takes cells on all its sides.
  [[nodiscard]] bool tells() const noexcept { return cells_ >= 3; }
  /// Along u and along v, from the middle, the farthest place of which around() may be true: in no outermost
  /// cell.
  [[nodiscard]] double farthest() const noexcept { return 1.0 - 2.0 / cells_; }
  /// Whether a place has points on all its sides, beyond doubt: in the cells around its own. A straight
  /// border beyond which that cell reaches leaves one of them empty, however it lies.
  [[nodiscard]] bool around(double a, double b) const noexcept {
    const int x = cell(a), y = cell(b);
    if (x < 1 || x + 1 >= cells_ || y < 1 || y + 1 >= cells_) return false;
    const std::uint64_t row = bit(x - 1, y) | bit(x, y) | bit(x + 1, y);
    const std::uint64_t asked = row | row << cells_ | row >> cells_;
    return (filled_ & asked) == asked;
  }

 private:
  static constexpr int kMostCells = 8;
  /// Six points a cell are none in one of 400. A disc takes a quarter of pi of its square.
  static constexpr double kPointsPerCell = 6.0, kDiscShare = 1.2732395;
  [[nodiscard]] int cell(double a) const noexcept {
    // Down, not to 0: what is cut off is positive.
    return static_cast<int>((std::clamp(0.5 * (a + 1.0), -1.0, 2.0) + 1.0) * cells_) - cells_;
  }
  [[nodiscard]] std::uint64_t bit(int x, int y) const noexcept {
    return std::uint64_t{1} << (y * cells_ + x);
  }
  std::uint64_t filled_ = 0;
  int cells_ = 1;
};

/// Directions along a tangent plane in which points were seen.
class Surround {
 public:
  void add(double a, double b) noexcept {
    seen_ |= std::uint64_t{1} << std::min(static_cast<int>(turn_of(a, b) * kSectors), kSectors - 1);
  }
  /// The points end here: at a straight border half a turn is empty, and what a sector more on either side
  /// takes of it.
  [[nodiscard]] bool open() const noexcept {
    // A bit of `empty` stays where the sectors from its own on are empty, as many as are told so far.
    std::uint64_t empty = ~seen_ & kAll;
    for (int told = 1; told < kOpenSectors;) {
      const int step = std::min(told, kOpenSectors - told);
      empty &= (empty >> step | empty << (kSectors - step)) & kAll;
      told += step;
    }
    return empty != 0;
  }

 private:
  static constexpr int kSectors = 48, kOpenSectors = kSectors / 2 - 2;
  static constexpr std::uint64_t kAll = (std::uint64_t{1} << kSectors) - 1;
  std::uint64_t seen_ = 0;
};

/// A point tells of a place within so many of its own spacings.
inline constexpr double kTellsSpacings = 4.0;

}  // namespace palpate::render
