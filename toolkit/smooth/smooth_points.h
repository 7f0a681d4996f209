// A cloud's points in Morton order, each place once, and what lies in a ball: what the smooth surface is made
// of.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/partition/morton_order.h"
#include "toolkit/smooth/cell_blocks.h"

namespace palpate::render {

/// The lattice coordinate that a Morton code stands for.
[[nodiscard]] std::array<std::int32_t, 3> coordinate_of(std::uint64_t code) noexcept;

/// An axis's bits of a Morton code, alone: of the next coordinate along it. Borrows pass over the bits
/// between.
template <int kAxis>
[[nodiscard]] constexpr std::uint64_t next_code(std::uint64_t code) noexcept {
  constexpr std::uint64_t kBits = 0x1249249249249249ull << kAxis;  // of 21 bits each third one
  return (code - kBits) & kBits;
}

/// Immutable; safe to read from many threads. Lengths in mm, places local to the cloud's origin.
class SmoothPoints {
 public:
  /// O(n), parallel; the same for any number of threads and any order of the points, but for points nearer
  /// to each other than 2^-20 of the extent.
  SmoothPoints(const cloud::Cloud& cloud, int threads);

  [[nodiscard]] std::size_t size() const noexcept { return at_.size(); }
  [[nodiscard]] Vec3 operator[](std::size_t i) const noexcept { return at_[i].cast<double>(); }
  /// Index in the cloud.
  [[nodiscard]] std::uint32_t index(std::size_t i) const noexcept { return order_[i]; }
  [[nodiscard]] const geometry::Aabb& box_mm() const noexcept { return box_mm_; }
  /// Median over the points of sqrt(area a point); 0 where no area is seen.
  [[nodiscard]] double spacing_mm() const noexcept { return spacing_mm_; }
  /// The same around one point, roughly: from the points in 27 cells.
  [[nodiscard]] double spacing_near(std::size_t i) const noexcept {
    return static_cast<double>(spacing_near_[i]);
  }

  /// A ball over more cubes than this, and than there are points, is found point by point: a cube costs about
  /// as much as a point. One point far off would else be surrounded by millions of empty cubes.
  static constexpr double kMostCubes = 4096.0;
  /// Calls visit(first, past) for runs of places that hold all points of the ball, and others; no more of
  /// them once it answers true, where it answers.
  template <class Visit>
  void about_ball(const Vec3& centre, double radius, Visit&& visit) const {
    const Level& level = level_for(radius);
    std::array<std::int64_t, 3> low{}, high{};
    if (!cells_of(level, centre, radius, low, high)) return;
    double cubes = 1.0;
    for (std::size_t axis = 0; axis < 3; ++axis) cubes *= static_cast<double>(high[axis] - low[axis] + 1);
    if (cubes > kMostCubes && cubes > static_cast<double>(at_.size())) {
      visit(std::uint32_t{0}, static_cast<std::uint32_t>(at_.size()));
      return;
    }
    const std::uint64_t code_x = partition::morton_code(static_cast<std::uint32_t>(low[0]), 0, 0);
    const std::uint64_t code_y = partition::morton_code(0, static_cast<std::uint32_t>(low[1]), 0);
    std::uint64_t cz = partition::morton_code(0, 0, static_cast<std::uint32_t>(low[2]));
    const double left_sq = radius * radius * kBallRoom;
    for (std::int64_t z = low[2]; z <= high[2]; ++z, cz = next_code<2>(cz)) {
      const double off_z = off_cell_sq(level, z, centre, 2);
      std::uint64_t cy = code_y;
      for (std::int64_t y = low[1]; y <= high[1]; ++y, cy = next_code<1>(cy)) {
        const double off_yz = off_z + off_cell_sq(level, y, centre, 1);
        std::uint64_t cx = code_x;
        for (std::int64_t x = low[0]; x <= high[0]; ++x, cx = next_code<0>(cx)) {
          if (off_yz + off_cell_sq(level, x, centre, 0) > left_sq) continue;
          const std::uint32_t cell = level.table.find(cx | cy | cz);
          if (cell == CellBlocks::kNone) continue;
          if constexpr (std::is_void_v<decltype(visit(std::uint32_t{0}, std::uint32_t{0}))>)
            visit(level.begin[cell], level.begin[cell + 1]);
          else if (visit(level.begin[cell], level.begin[cell + 1]))
            return;
        }
      }
    }
  }
  /// Calls visit(place, Vec3 from the centre, squared distance) for every point in the ball.
  template <class Visit>
  void in_ball(const Vec3& centre, double radius, Visit&& visit) const {
    const double radius_sq = radius * radius;
    about_ball(centre, radius, [&](std::uint32_t first, std::uint32_t past) {
      for (std::uint32_t i = first; i < past; ++i) {
        const Vec3 away = at_[i].cast<double>() - centre;
        const double sq = away.squaredNorm();
        if (sq <= radius_sq) visit(i, away, sq);
      }
    });
  }
  [[nodiscard]] bool any_in_ball(const Vec3& centre, double radius) const {
    bool any = false;
    about_ball(centre, radius, [&](std::uint32_t first, std::uint32_t past) {
      for (std::uint32_t i = first; i < past && !any; ++i)
        any = (at_[i].cast<double>() - centre).squaredNorm() <= radius * radius;
      return any;
    });
    return any;
  }
  [[nodiscard]] int count_in_ball(const Vec3& centre, double radius) const {
    int count = 0;
    in_ball(centre, radius, [&](std::uint32_t, const Vec3&, double) { ++count; });
    return count;
  }

 private:
  /// Cubes of one size and the points of each.
  struct Level {
    double cell_mm = 1.0;
    int bits = 0;  ///< of each axis's lattice coordinate that lie inside a cube
    CellBlocks table;
    std::vector<std::uint32_t> begin;
  };
  /// Cells this little outside of a ball are looked at as well: rounding of places to cells.
  static constexpr double kBallRoom = 1.0 + 1e-4;
  /// How far, squared, a place is from the slab of a cell along an axis.
  [[nodiscard]] double off_cell_sq(const Level& level, std::int64_t cell, const Vec3& place,
                                   int axis) const noexcept {
    const double from_low = place[axis] - lattice_.low_mm[axis] - static_cast<double>(cell) * level.cell_mm;
    const double off = std::max(std::max(-from_low, from_low - level.cell_mm), 0.0);
    return off * off;
  }
  [[nodiscard]] const Level& level_for(double radius) const noexcept;
  bool cells_of(const Level& level, const Vec3& centre, double radius, std::array<std::int64_t, 3>& low,
                std::array<std::int64_t, 3>& high) const noexcept;
  [[nodiscard]] static std::uint32_t points_around_cell(const Level& level, std::uint64_t code) noexcept;
  /// Sorts what stands in one cube of the lattice, and leaves out places that are there already.
  void settle_equal(std::vector<std::uint64_t>& codes);
  void build_levels(const std::vector<std::uint64_t>& codes, int threads);
  void measure_spacing();
  void measure_spacing_near(int threads);

  partition::Lattice lattice_;
  geometry::Aabb box_mm_;
  std::vector<Vec3f> at_;
  std::vector<std::uint32_t> order_;
  std::vector<Level> levels_;
  std::vector<float> spacing_near_;
  double spacing_mm_ = 0.0;
};

}  // namespace palpate::render
