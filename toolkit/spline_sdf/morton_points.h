// A cloud's distinct points in Morton order, with ball queries; input of the smooth surface.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/vec.h>
#include "toolkit/core/hardware.h"
#include "toolkit/search/morton_order.h"

namespace palpate::spline_sdf {

/// Makes points of a part of a cloud the same, and in the same order, as among all points: what the whole
/// cloud decides. Lengths in mm, relative to the cloud's origin.
struct PointFrame {
  geometry::Aabb box_mm;       ///< of all points
  double spacing_mm = 0.0;     ///< MortonPoints::spacing_mm() of all
  double block_spacings = 32;  ///< edge of a block, at least; less than twice as much
};

/// Immutable but for drop_order(); thread-safe. Lengths in mm, relative to the cloud's origin.
class MortonPoints {
 public:
  /// Points of a block: about 64 spacings square, several of the largest patches.
  static constexpr std::size_t kBlockPoints = 4096;

  /// O(n), parallel. Independent of the number of threads and of the points' order, except for points nearer
  /// than 2^-20 of the extent.
  MortonPoints(const cloud::Cloud& cloud, int threads) : MortonPoints(cloud, nullptr, threads) {}
  /// `frame`: null where `cloud` is all.
  MortonPoints(const cloud::Cloud& cloud, const PointFrame* frame, int threads);

  [[nodiscard]] std::size_t size() const noexcept { return at_.size(); }
  [[nodiscard]] Vec3 operator[](std::size_t i) const noexcept { return at_[i].cast<double>(); }
  /// Index in the cloud, until drop_order().
  [[nodiscard]] std::uint32_t index(std::size_t i) const noexcept { return order_[i]; }
  void drop_order() noexcept { release_memory(order_); }
  [[nodiscard]] const geometry::Aabb& box_mm() const noexcept { return box_mm_; }
  /// First points of the blocks that patches are fitted in, each without regard to the others, and the number
  /// of points. A frame's blocks are the same in every part that holds them.
  [[nodiscard]] std::span<const std::uint32_t> blocks() const noexcept { return blocks_; }
  /// Median over the points of sqrt(area per point); 0 if no area is found.
  [[nodiscard]] double spacing_mm() const noexcept { return spacing_mm_; }
  /// The approximate spacing around one point, from 27 cells.
  [[nodiscard]] double spacing_near(std::size_t i) const noexcept {
    return static_cast<double>(spacing_near_[i]);
  }

  /// A ball over more cubes than this, and than there are points, is searched point by point (a cube costs
  /// about as much). Otherwise one far point would search millions of empty cubes.
  static constexpr double kMaxCubes = 4096.0;
  /// Calls visit(first, past) for runs of places that include all points of the ball. If visit returns bool,
  /// true stops it.
  template <class Visit>
  void visit_runs_near_ball(const Vec3& centre, double radius, Visit&& visit) const {
    const Level& level = level_for(radius);
    std::array<std::int64_t, 3> low{}, high{};
    if (!cells_of(level, centre, radius, low, high)) return;
    double cubes = 1.0;
    for (std::size_t axis = 0; axis < 3; ++axis) cubes *= static_cast<double>(high[axis] - low[axis] + 1);
    if (cubes > kMaxCubes && cubes > static_cast<double>(at_.size())) {
      visit(std::uint32_t{0}, static_cast<std::uint32_t>(at_.size()));
      return;
    }
    const std::uint64_t code_x = search::morton_code(static_cast<std::uint32_t>(low[0]), 0, 0);
    const std::uint64_t code_y = search::morton_code(0, static_cast<std::uint32_t>(low[1]), 0);
    std::uint64_t cz = search::morton_code(0, 0, static_cast<std::uint32_t>(low[2]));
    const double left_sq = radius * radius * kBallMargin;
    for (std::int64_t z = low[2]; z <= high[2]; ++z, cz = search::next_code<2>(cz)) {
      const double off_z = distance_to_cell_sq(level, z, centre, 2);
      std::uint64_t cy = code_y;
      for (std::int64_t y = low[1]; y <= high[1]; ++y, cy = search::next_code<1>(cy)) {
        const double off_yz = off_z + distance_to_cell_sq(level, y, centre, 1);
        std::uint64_t cx = code_x;
        for (std::int64_t x = low[0]; x <= high[0]; ++x, cx = search::next_code<0>(cx)) {
          if (off_yz + distance_to_cell_sq(level, x, centre, 0) > left_sq) continue;
          const std::uint32_t cell = level.table.find(cx | cy | cz);
          if (cell == search::MortonCellTable::kNone) continue;
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
    visit_runs_near_ball(centre, radius, [&](std::uint32_t first, std::uint32_t past) {
      for (std::uint32_t i = first; i < past; ++i) {
        const Vec3 away = at_[i].cast<double>() - centre;
        const double sq = away.squaredNorm();
        if (sq <= radius_sq) visit(i, away, sq);
      }
    });
  }
  [[nodiscard]] bool any_in_ball(const Vec3& centre, double radius) const {
    bool any = false;
    visit_runs_near_ball(centre, radius, [&](std::uint32_t first, std::uint32_t past) {
      for (std::uint32_t i = first; i < past && !any; ++i)
        any = (at_[i].cast<double>() - centre).squaredNorm() <= radius * radius;
      return any;
    });
    return any;
  }

 private:
  /// Cubes of one size and their points.
  struct Level {
    double cell_mm = 1.0;
    int bits = 0;  ///< bits of a lattice coordinate inside a cube
    search::MortonCellTable table;
    std::vector<std::uint32_t> begin;
  };
  /// Enlarges the ball for the rounding of places to cells.
  static constexpr double kBallMargin = 1.0 + 1e-4;
  /// Squared distance of a place to a cell's slab along an axis.
  [[nodiscard]] double distance_to_cell_sq(const Level& level, std::int64_t cell, const Vec3& place,
                                           int axis) const noexcept {
    const double from_low = place[axis] - lattice_.low_mm[axis] - static_cast<double>(cell) * level.cell_mm;
    const double off = std::max(std::max(-from_low, from_low - level.cell_mm), 0.0);
    return off * off;
  }
  [[nodiscard]] const Level& level_for(double radius) const noexcept;
  bool cells_of(const Level& level, const Vec3& centre, double radius, std::array<std::int64_t, 3>& low,
                std::array<std::int64_t, 3>& high) const noexcept;
  [[nodiscard]] static std::uint32_t points_around_cell(const Level& level, std::uint64_t code) noexcept;
  /// Sorts within lattice cells and removes duplicates.
  void remove_duplicates(std::vector<std::uint64_t>& codes);
  /// `bits`: of the finest level; negative: by the points.
  void build_levels(const std::vector<std::uint64_t>& codes, int bits, int threads);
  void cut_blocks(const std::vector<std::uint64_t>& codes, const PointFrame* frame);
  void measure_spacing();
  void measure_spacing_near(int threads);

  search::Lattice lattice_;
  geometry::Aabb box_mm_;
  std::vector<Vec3f> at_;
  std::vector<std::uint32_t> order_;
  std::vector<Level> levels_;
  std::vector<float> spacing_near_;
  std::vector<std::uint32_t> blocks_;
  double spacing_mm_ = 0.0;
};

}  // namespace palpate::spline_sdf
