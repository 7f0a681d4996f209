// Tests whether points surround a place or end there. The widest empty angle decides, which is independent of
// density.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/spline_sdf/morton_points.h"

namespace palpate::spline_sdf {

/// A direction's angle in turns, 0 to 1, accurate to 0.0008; 0 for a zero direction.
[[nodiscard]] inline double angle_in_turns(double a, double b) noexcept {
  const auto eighth = [](double tangent) { return tangent * (0.1547623 - 0.0305418 * tangent * tangent); };
  const double x = std::abs(a), y = std::abs(b);
  if (!(x + y > 0.0)) return 0.0;
  double turn = x > y ? eighth(y / x) : 0.25 - eighth(x / y);
  if (a < 0.0) turn = 0.5 - turn;
  return b < 0.0 ? 1.0 - turn : turn;
}

/// Cells of a disc that hold points: a square grid of up to 8 x 8, by the number of points.
class DiscOccupancy {
 public:
  DiscOccupancy() = default;
  /// `points`: the most in the disc.
  explicit DiscOccupancy(std::size_t points) {
    while (cells_ < kMaxCells &&
           kPointsPerCell * (cells_ + 1) * (cells_ + 1) <= kDiscShare * static_cast<double>(points))
      ++cells_;
  }
  /// (a, b) in radii.
  void add(double a, double b) noexcept {
    const int x = cell(a), y = cell(b);
    if (x >= 0 && x < cells_ && y >= 0 && y < cells_) filled_ |= bit(x, y);
  }
  /// True if the cells around the place's own are occupied. A straight border that its cell crosses leaves
  /// one empty at any angle.
  [[nodiscard]] bool around(double a, double b) const noexcept {
    const int x = cell(a), y = cell(b);
    if (x < 1 || x + 1 >= cells_ || y < 1 || y + 1 >= cells_) return false;
    const std::uint64_t row = bit(x - 1, y) | bit(x, y) | bit(x + 1, y);
    const std::uint64_t asked = row | row << cells_ | row >> cells_;
    return (filled_ & asked) == asked;
  }

 private:
  static constexpr int kMaxCells = 8;
  /// With six points a cell, one in 400 is empty by chance. A disc covers pi / 4 of its square.
  static constexpr double kPointsPerCell = 6.0, kDiscShare = 1.2732395;
  [[nodiscard]] int cell(double a) const noexcept {
    // Truncation equals floor: the value is positive.
    return static_cast<int>((std::clamp(0.5 * (a + 1.0), -1.0, 2.0) + 1.0) * cells_) - cells_;
  }
  [[nodiscard]] std::uint64_t bit(int x, int y) const noexcept {
    return std::uint64_t{1} << (y * cells_ + x);
  }
  std::uint64_t filled_ = 0;
  int cells_ = 1;
};

/// Directions in a tangent plane in which points were seen.
class SectorMask {
 public:
  void add(double a, double b) noexcept {
    seen_ |= std::uint64_t{1} << std::min(static_cast<int>(angle_in_turns(a, b) * kSectors), kSectors - 1);
  }
  /// True if the points end here: a straight border leaves half a turn empty, less a sector on either side.
  [[nodiscard]] bool open() const noexcept {
    // A bit of `empty` stays set while the sectors from its own on are empty.
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

/// A point informs places within this many of its spacings.
inline constexpr double kInfluenceSpacings = 4.0;

/// Scratch memory, reused between cubes. Belongs to one thread.
class InteriorTest {
 public:
  /// Prepares queries within `reach_mm` of a cube's middle; `spacing`: of its patches' points, mm. Keeps a
  /// reference.
  void begin(const MortonPoints& points, const Vec3& middle, double reach_mm, double spacing);
  /// For a place relative to the middle, on a surface of unit normal n. O(points around), mostly the nearest.
  [[nodiscard]] bool is_interior(const Vec3& closest, const Vec3& n);

 private:
  /// A point relative to the cube's middle, and its range.
  struct Near {
    Vec3 at;
    double reach_sq;
  };
  [[nodiscard]] double reach_sq(std::uint32_t point) const;
  [[nodiscard]] bool nearest_points_surround(const Vec3& closest, const Vec3& n, const Vec3& u,
                                             const Vec3& v) const;
  void gather();

  const MortonPoints* points_ = nullptr;
  Vec3 middle_ = Vec3::Zero();
  double reach_mm_ = 0.0, spacing_ = 0.0;
  std::vector<Near> near_;  ///< of the cube, once a place's nearest ones did not decide
  std::size_t count_ = 0;   ///< used size
  bool gathered_ = false;
};

}  // namespace palpate::spline_sdf
