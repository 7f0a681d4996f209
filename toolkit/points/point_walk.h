// The constrained search for the god object: from point to neighbouring point, always nearer to the HIP
// (section 3.2.3). Shared by every point renderer.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

#include "toolkit/points/point_model.h"

namespace palpate::points {

/// Moves a frame may make over the neighbour graph. At 50 mm/s the HIP crosses half a spacing of 0.1 mm a
/// frame; 64 moves carry the god object over 6 mm of such a surface, 6 m/s at 1 kHz.
inline constexpr int kMaxWalkSteps = 64;

/// The end of a walk, with what was seen around it: arrays by neighbour, so that loops over the eight
/// vectorise.
struct WalkResult {
  std::uint32_t place = 0;
  double distance_sq_mm2 = 0.0;
  double neighbour_sq_mm2[search::kNeighbours];  ///< from the HIP to each neighbour of `place`
  double x_mm[search::kNeighbours], y_mm[search::kNeighbours], z_mm[search::kNeighbours];

  void load_neighbours(const PointModel& model, const Vec3& h) noexcept {
    const search::Neighbours& around = model.neighbours[place];
    for (std::size_t k = 0; k < search::kNeighbours; ++k) {
      const StoredPoint& p = model.points[around[k]];
      x_mm[k] = static_cast<double>(p.x_mm);
      y_mm[k] = static_cast<double>(p.y_mm);
      z_mm[k] = static_cast<double>(p.z_mm);
    }
    const double hx = h.x(), hy = h.y(), hz = h.z();
    for (std::size_t k = 0; k < search::kNeighbours; ++k) {
      const double dx = x_mm[k] - hx, dy = y_mm[k] - hy, dz = z_mm[k] - hz;
      neighbour_sq_mm2[k] = dx * dx + dy * dy + dz * dz;
    }
  }
};

[[nodiscard]] inline double distance_sq(const StoredPoint& p, const Vec3& h) noexcept {
  const double dx = static_cast<double>(p.x_mm) - h.x(), dy = static_cast<double>(p.y_mm) - h.y(),
               dz = static_cast<double>(p.z_mm) - h.z();
  return dx * dx + dy * dy + dz * dz;
}

/// Orders squared distances together with which neighbour they belong to, so that a minimum is found without
/// a branch: the bits of a positive double order as it does, and the last three are given to the neighbour.
/// Distances that agree to 50 bits count as equal; of those the neighbour listed first comes first.
[[nodiscard]] inline std::uint64_t order_key(double square, std::size_t k) noexcept {
  return (std::bit_cast<std::uint64_t>(square) & ~std::uint64_t{7}) | k;
}
inline constexpr std::uint64_t kNoKey = ~std::uint64_t{0};
static_assert(search::kNeighbours == 8, "three bits name a neighbour");

/// Steepest descent with strict decrease from `start` to a local minimum of the distance to `h`; ties go to
/// the neighbour listed first. `moved(place)` is called for every move. `steps` counts down; at 0 the walk
/// stops where it is. At most `steps` + 1 visits of eight neighbours.
template <class Moved>
[[nodiscard]] inline WalkResult walk(const PointModel& model, std::uint32_t start, const Vec3& h, int& steps,
                                     Moved&& moved) noexcept {
  WalkResult end;
  end.place = start;
  end.distance_sq_mm2 = distance_sq(model.points[start], h);
  while (true) {
    end.load_neighbours(model, h);
    std::uint64_t least = kNoKey;
    for (std::size_t k = 0; k < search::kNeighbours; ++k)
      least = std::min(least, order_key(end.neighbour_sq_mm2[k], k));
    const std::size_t best = least & 7u;
    if (!(end.neighbour_sq_mm2[best] < end.distance_sq_mm2) || steps <= 0) return end;
    --steps;
    end.place = model.neighbours[end.place][best];
    end.distance_sq_mm2 = end.neighbour_sq_mm2[best];
    moved(end.place);
  }
}

/// The two neighbours of the walk's end that are nearest to the HIP; the end itself where there are fewer.
struct NearestTwo {
  std::uint32_t first, second;
};
[[nodiscard]] inline NearestTwo nearest_two(const PointModel& model, const WalkResult& end) noexcept {
  const search::Neighbours& around = model.neighbours[end.place];
  std::uint64_t first = kNoKey, second = kNoKey;
  for (std::size_t k = 0; k < search::kNeighbours; ++k) {
    const std::uint64_t key =
        around[k] == end.place ? kNoKey : order_key(end.neighbour_sq_mm2[k], k);  // itself: no neighbour
    second = std::min(second, std::max(first, key));
    first = std::min(first, key);
  }
  return {first == kNoKey ? end.place : around[first & 7u],
          second == kNoKey ? end.place : around[second & 7u]};
}

}  // namespace palpate::points
