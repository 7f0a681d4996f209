// A piece of surface that the probe is near or in: the god object on it and the side that is outside.
#pragma once

#include <cmath>
#include <cstdint>

#include "toolkit/render/point_model.h"
#include "toolkit/render/point_walk.h"

namespace palpate::render {

/// Wider looks a frame may take at a place where the greedy walk seems stuck; each reads at most 64 points.
inline constexpr int kMaxRescues = 4;
/// A true nearest sample lies within the covering radius of the samples, which is at most the distance to the
/// eighth neighbour: when the HIP is further to the side than this many local resolutions, the walk may be
/// stuck.
inline constexpr double kStuckResolutions = 1.0;

/// The god object's point and the outward normal carried to it. A side is decided once, where the probe came
/// from, and carried from point to point: neighbouring planes are less than a right angle apart.
struct Sheet {
  std::uint32_t place = 0;
  Vec3 outward = Vec3::UnitZ();
  double distance_sq_mm2 = 0.0;  ///< HIP to the point at `place`
  bool walk_cut = false;         ///< the bound on steps was reached; the walk goes on in the next frame
};

/// The plane at `place`, its sign chosen to agree with `like`; `like` itself where the points give no plane.
[[nodiscard]] inline Vec3 plane_like(const PointModel& model, std::uint32_t place,
                                     const Vec3& like) noexcept {
  const surface::NormalCode code = model.points[place].normal;
  if (code == surface::kNoNormal) return like;
  const Vec3 n = surface::decode_normal(code);
  return n.dot(like) < 0.0 ? Vec3(-n) : n;
}

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

/// Squared sideways distance of `h` from the sheet's normal line.
[[nodiscard]] inline double sideways_sq(const PointModel& model, const Sheet& sheet, const Vec3& h) noexcept {
  const Vec3 r = h - model.points[sheet.place].at();
  const double height = sheet.outward.dot(r);
  return r.squaredNorm() - height * height;
}

/// Moves the sheet's god object to the local minimum of the distance to `h`, carrying the side. Where the
/// walk stops although the HIP is far to the side, the neighbours' neighbours are looked at too (a greedy
/// walk on eight-neighbour graphs can stop at a false minimum) and the walk goes on from there.
[[nodiscard]] inline WalkEnd follow(const PointModel& model, Sheet& sheet, const Vec3& h, int& steps,
                                    FrameCounters& counters) noexcept {
  const int before = steps;
  const auto carry = [&](std::uint32_t place) { sheet.outward = plane_like(model, place, sheet.outward); };
  WalkEnd end = walk(model, sheet.place, h, steps, carry);
  for (int rescue = 0; rescue < kMaxRescues && steps > 0; ++rescue) {
    sheet.place = end.place;
    if (!(sideways_sq(model, sheet, h) >
          kStuckResolutions * kStuckResolutions * local_resolution_sq(model, end.place)))
      break;
    std::uint32_t better = end.place, via = end.place;
    double nearest = end.distance_sq_mm2;
    for (const std::uint32_t first : model.neighbours[end.place])
      for (const std::uint32_t second : model.neighbours[first]) {
        const double d = distance_sq(model.points[second], h);
        if (d < nearest) {
          nearest = d;
          better = second;
          via = first;
        }
      }
    if (better == end.place) break;
    ++counters.local_minima;
    carry(via);
    carry(better);
    end = walk(model, better, h, steps, carry);
  }
  sheet.place = end.place;
  sheet.distance_sq_mm2 = end.distance_sq_mm2;
  sheet.walk_cut = steps == 0;
  counters.walk_steps += static_cast<std::uint64_t>(before - steps);
  return end;
}

}  // namespace palpate::render
