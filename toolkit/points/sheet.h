// A piece of surface that the probe is near or in: the god object on it and the side that is outside.
#pragma once

#include <Eigen/Geometry>  // cross products
#include <cmath>
#include <cstdint>
#include <limits>

#include "toolkit/points/point_model.h"
#include "toolkit/points/point_walk.h"
#include "toolkit/surface/fan.h"

namespace palpate::render {

/// Wider looks a frame may take at a place where the greedy walk seems stuck; each reads at most 64 points.
inline constexpr int kMaxRescues = 4;
/// On a square lattice the nearest sample lies within half a diagonal, 0.71 of the distance to the fourth
/// neighbour. Where the HIP is further to the side than this many times that distance, a fifth more than the
/// lattice needs, the walk may be stuck and is worth a wider look. The fourth and not the eighth: neighbours
/// that were chosen to go different ways may end far away.
inline constexpr double kStuckSpacings = 0.85;
inline constexpr std::size_t kFourth = 3;

using surface::kFacetCosine;

/// Linked points whose planes are turned by more than 20 degrees, less than the 25.6 that a hand tells apart
/// at rest, have an edge between them: cos 20 = 0.94.
inline constexpr double kEdgeCosine = 0.94;
/// In place of a place: none.
inline constexpr std::uint32_t kNoPlace = std::numeric_limits<std::uint32_t>::max();

/// The god object's point and the side that is outside. The normals of a surface agree on a side (surface
/// orientation), so one sign, decided where the probe came from, holds wherever the god object goes.
struct Sheet {
  std::uint32_t place = 0;
  double side = 1.0;             ///< 1: the stored normals point outward, -1: inward
  Vec3 outward = Vec3::UnitZ();  ///< at `place`; kept from before where the points give no plane
  double distance_sq_mm2 = 0.0;  ///< HIP to the point at `place`
  bool walk_cut = false;         ///< the bound on steps was reached; the walk goes on in the next frame
  std::uint32_t turned_from =
      kNoPlace;  ///< the last walk came from there, around an edge; cleared by who asks

  /// The normal of the new place.
  void set_outward(const PointModel& model) noexcept {
    const surface::NormalCode code = model.points[place].normal;
    if (code != surface::kNoNormal) outward = side * surface::decode_normal(code);
  }
};

/// Height of `h` over the sheet's plane; negative inside.
[[nodiscard]] inline double height_mm(const PointModel& model, const Sheet& sheet, const Vec3& h) noexcept {
  return sheet.outward.dot(h - model.points[sheet.place].at());
}

/// Squared distance from the sheet's point to its farthest neighbour: the local resolution.
[[nodiscard]] inline double local_resolution_sq(const PointModel& model, std::uint32_t place) noexcept {
  const neighbourhood::Neighbours& around = model.neighbours[place];
  const Vec3 p = model.points[place].at();
  for (std::size_t k = neighbourhood::kNeighbours; k-- > 0;)
    if (around[k] != place) return distance_sq(model.points[around[k]], p);
  return 0.0;
}

/// Squared distance from a point to its fourth neighbour; 0 where it has fewer.
[[nodiscard]] inline double fourth_sq(const PointModel& model, std::uint32_t place) noexcept {
  return distance_sq(model.points[model.neighbours[place][kFourth]], model.points[place].at());
}

/// Squared sideways distance of `h` from the sheet's normal line.
[[nodiscard]] inline double sideways_sq(const PointModel& model, const Sheet& sheet, const Vec3& h) noexcept {
  const Vec3 r = h - model.points[sheet.place].at();
  const double height = sheet.outward.dot(r);
  return r.squaredNorm() - height * height;
}

/// Moves the sheet's god object to the local minimum of the distance to `h`. Where the walk stops although
/// the HIP is far to the side, the neighbours' neighbours are looked at too (a greedy walk on eight-neighbour
/// graphs can stop at a false minimum) and the walk goes on from there.
[[nodiscard]] inline WalkEnd follow(const PointModel& model, Sheet& sheet, const Vec3& h, int& steps,
                                    FrameCounters& counters) noexcept {
  const int before = steps;
  WalkEnd end = walk(model, sheet.place, h, steps, [](std::uint32_t) {});
  for (int rescue = 0;; ++rescue) {
    if (end.place != sheet.place || rescue > 0) {
      const Vec3 outward = sheet.outward;
      const std::uint32_t from = sheet.place;
      sheet.place = end.place;
      sheet.set_outward(model);
      if (outward.dot(sheet.outward) < kEdgeCosine) [[unlikely]]
        sheet.turned_from = from;
    }
    if (rescue == kMaxRescues || steps <= 0 ||
        !(sideways_sq(model, sheet, h) > kStuckSpacings * kStuckSpacings * fourth_sq(model, end.place)))
      break;
    std::uint32_t better = end.place;
    double nearest = end.distance_sq_mm2;
    for (const std::uint32_t first : model.neighbours[end.place])
      for (const std::uint32_t second : model.neighbours[first]) {
        const double d = distance_sq(model.points[second], h);
        if (d < nearest) {
          nearest = d;
          better = second;
        }
      }
    if (better == end.place) break;
    ++counters.local_minima;
    end = walk(model, better, h, steps, [](std::uint32_t) {});
  }
  sheet.distance_sq_mm2 = end.distance_sq_mm2;
  sheet.walk_cut = steps == 0;
  counters.walk_steps += static_cast<std::uint64_t>(before - steps);
  return end;
}

/// Neighbours of the god object whose facet with it encloses the HIP's projection, as well as eight
/// neighbours can tell: the first is the one nearest to the HIP, the second the nearest on the HIP's side of
/// the line to the first. Unlike the two nearest of the printed shading they never lie on one line with the
/// god object.
[[nodiscard]] inline NearestTwo enclosing_two(const PointModel& model, const WalkEnd& end,
                                              const Vec3& outward, const Vec3& h) noexcept {
  const NearestTwo two = nearest_two(model, end);
  const Vec3 g = model.points[end.place].at();
  const Vec3 along = model.points[two.first].at() - g;
  const Vec3 across = outward.cross(along);  // in the surface, square to the line
  const double side = across.dot(h - g);
  const double least = kFacetCosine * kFacetCosine * across.squaredNorm();
  const double turn = side < 0.0 ? -1.0 : 1.0;
  const double ax = turn * across.x(), ay = turn * across.y(), az = turn * across.z();
  const double gx = g.x(), gy = g.y(), gz = g.z();
  double aside[neighbourhood::kNeighbours], enough[neighbourhood::kNeighbours];
  for (std::size_t k = 0; k < neighbourhood::kNeighbours; ++k) {
    const double dx = end.x_mm[k] - gx, dy = end.y_mm[k] - gy, dz = end.z_mm[k] - gz;
    aside[k] = ax * dx + ay * dy + az * dz;
    enough[k] = least * (dx * dx + dy * dy + dz * dz);
  }
  // aside^2 = |across|^2 |step|^2 cos^2; points on the line or behind it do not count. Without a branch:
  // which neighbours count changes from frame to frame.
  std::uint64_t nearest = kNoKey;
  for (std::size_t k = 0; k < neighbourhood::kNeighbours; ++k) {
    const bool counts = (aside[k] > 0.0) & (aside[k] * aside[k] >= enough[k]);
    nearest = std::min(nearest, order_key(end.neighbour_sq_mm2[k], k) | (std::uint64_t{counts} - 1));
  }
  const neighbourhood::Neighbours& around = model.neighbours[end.place];
  return {two.first, nearest == kNoKey ? two.second : around[nearest & 7u]};
}

}  // namespace palpate::render
