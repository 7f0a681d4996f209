// The constrained search for the god object: from point to neighbouring point, always nearer to the HIP
// (section 3.2.3). Shared by every point renderer.
#pragma once

#include <cstdint>

#include "toolkit/render/point_model.h"

namespace palpate::render {

/// Moves a frame may make over the neighbour graph. At 50 mm/s the HIP crosses half a spacing of 0.1 mm a
/// frame; 64 moves carry the god object over 6 mm of such a surface, 6 m/s at 1 kHz.
inline constexpr int kMaxWalkSteps = 64;

/// The end of a walk.
struct WalkEnd {
  std::uint32_t place = 0;
  double distance_sq_mm2 = 0.0;
  double neighbour_sq_mm2[neighbourhood::kNeighbours];  ///< from the HIP to each neighbour of `place`
};

[[nodiscard]] inline double distance_sq(const StoredPoint& p, const Vec3& h) noexcept {
  const double dx = static_cast<double>(p.x_mm) - h.x(), dy = static_cast<double>(p.y_mm) - h.y(),
               dz = static_cast<double>(p.z_mm) - h.z();
  return dx * dx + dy * dy + dz * dz;
}

/// Steepest descent with strict decrease from `start` to a local minimum of the distance to `h`; ties go to
/// the neighbour listed first. `moved(place)` is called for every move. `steps` counts down; at 0 the walk
/// stops where it is. At most `steps` + 1 looks at eight neighbours.
template <class Moved>
[[nodiscard]] inline WalkEnd walk(const PointModel& model, std::uint32_t start, const Vec3& h, int& steps,
                                  Moved&& moved) noexcept {
  WalkEnd end;
  end.place = start;
  end.distance_sq_mm2 = distance_sq(model.points[start], h);
  while (true) {
    const neighbourhood::Neighbours& around = model.neighbours[end.place];
    for (std::size_t k = 0; k < neighbourhood::kNeighbours; ++k)
      end.neighbour_sq_mm2[k] = distance_sq(model.points[around[k]], h);
    std::size_t best = 0;
    for (std::size_t k = 1; k < neighbourhood::kNeighbours; ++k)
      if (end.neighbour_sq_mm2[k] < end.neighbour_sq_mm2[best]) best = k;
    if (!(end.neighbour_sq_mm2[best] < end.distance_sq_mm2) || steps <= 0) return end;
    --steps;
    end.place = around[best];
    end.distance_sq_mm2 = end.neighbour_sq_mm2[best];
    moved(end.place);
  }
}

/// The two neighbours of the walk's end that are nearest to the HIP; the end itself where there are fewer.
struct NearestTwo {
  std::uint32_t first, second;
};
[[nodiscard]] inline NearestTwo nearest_two(const PointModel& model, const WalkEnd& end) noexcept {
  const neighbourhood::Neighbours& around = model.neighbours[end.place];
  constexpr double kFar = 1e300;  // beyond any squared distance of floats
  double d1 = kFar, d2 = kFar;
  NearestTwo two{end.place, end.place};
  for (std::size_t k = 0; k < neighbourhood::kNeighbours; ++k) {
    if (around[k] == end.place) continue;
    const double d = end.neighbour_sq_mm2[k];
    if (d < d1) {
      d2 = d1;
      two.second = two.first;
      d1 = d;
      two.first = around[k];
    } else if (d < d2) {
      d2 = d;
      two.second = around[k];
    }
  }
  return two;
}

}  // namespace palpate::render
