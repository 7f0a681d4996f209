// A piece of surface near or around the probe: its god object, its outward side, and the place that holds the
// god object where several facets do (the bottom of a groove, a corner of three planes).
#pragma once

#include <Eigen/Geometry>  // cross products

#include <cmath>
#include <cstdint>
#include <limits>

#include "toolkit/points/point_model.h"
#include "toolkit/points/point_walk.h"
#include "toolkit/render/shading.h"

namespace palpate::baselines::vertices {

using namespace render;

/// Most wider looks per frame where the greedy walk seems stuck; each reads at most 64 points.
inline constexpr int kMaxEscapes = 4;
/// Sideways distance, in distances to the fourth neighbour, beyond which the walk may be stuck and looks
/// wider. On a square lattice the nearest sample is within half a diagonal, 0.71; this is a fifth more. The
/// fourth, not the eighth, because neighbours chosen by direction may be far.
inline constexpr double kStuckSpacings = 0.85;
inline constexpr std::size_t kFourthNeighbour = 3;

/// Linked points with planes turned by more than 20 degrees (cos 0.94) have an edge between them; a hand at
/// rest tells 25.6 degrees apart.
inline constexpr double kEdgeCosine = 0.94;
/// Least angle of a facet's third corner off the line of the other two: sin 15 degrees = 0.26.
inline constexpr double kMinFacetSine = 0.26;
/// Stands for "no place".
inline constexpr std::uint32_t kNoPlace = std::numeric_limits<std::uint32_t>::max();

/// The god object's point and its outward side. A surface's normals are consistently oriented, so the sign
/// chosen where the probe came from holds everywhere.
struct Sheet {
  std::uint32_t place = 0;
  double side = 1.0;                     ///< 1: the stored normals point outward, -1: inward
  Vec3 outward = Vec3::UnitZ();          ///< at `place`; kept from before if the points give no plane
  double distance_sq_mm2 = 0.0;          ///< HIP to the point at `place`
  bool walk_truncated = false;           ///< the bound on steps was reached; the next frame continues
  std::uint32_t turned_from = kNoPlace;  ///< start of the last walk, around an edge; the reader clears it

  /// Takes the normal of the new place.
  void set_outward(const points::PointModel& model) noexcept {
    const surface::NormalCode code = model.points[place].normal;
    if (code != surface::kNoNormal) outward = side * surface::decode_normal(code);
  }
};

/// Height of `h` over the sheet's plane; negative inside.
[[nodiscard]] inline double height_mm(const points::PointModel& model, const Sheet& sheet,
                                      const Vec3& h) noexcept {
  return sheet.outward.dot(h - model.points[sheet.place].at());
}

/// Squared distance of the sheet's point to its farthest neighbour: the local resolution.
[[nodiscard]] inline double local_resolution_sq(const points::PointModel& model,
                                                std::uint32_t place) noexcept {
  const search::Neighbours& around = model.neighbours[place];
  const Vec3 p = model.points[place].at();
  for (std::size_t k = search::kNeighbours; k-- > 0;)
    if (around[k] != place) return points::distance_sq(model.points[around[k]], p);
  return 0.0;
}

/// Squared distance of a point to its fourth neighbour; 0 with fewer.
[[nodiscard]] inline double fourth_neighbour_sq(const points::PointModel& model,
                                                std::uint32_t place) noexcept {
  return points::distance_sq(model.points[model.neighbours[place][kFourthNeighbour]],
                             model.points[place].at());
}

/// Squared sideways distance of `h` from the sheet's normal line.
[[nodiscard]] inline double sideways_sq(const points::PointModel& model, const Sheet& sheet,
                                        const Vec3& h) noexcept {
  const Vec3 r = h - model.points[sheet.place].at();
  const double height = sheet.outward.dot(r);
  return r.squaredNorm() - height * height;
}

/// Moves the sheet's god object to the local minimum of the distance to `h`. If it stops with the HIP far to
/// the side, also tries the neighbours' neighbours, because greedy walks on eight-neighbour graphs can stop
/// at false minima.
[[nodiscard]] inline points::WalkResult follow(const points::PointModel& model, Sheet& sheet, const Vec3& h,
                                               int& steps, FrameCounters& counters) noexcept {
  const int before = steps;
  points::WalkResult end = points::walk(model, sheet.place, h, steps, [](std::uint32_t) {});
  for (int rescue = 0;; ++rescue) {
    if (end.place != sheet.place || rescue > 0) {
      const Vec3 outward = sheet.outward;
      const std::uint32_t from = sheet.place;
      sheet.place = end.place;
      sheet.set_outward(model);
      if (outward.dot(sheet.outward) < kEdgeCosine) [[unlikely]]
        sheet.turned_from = from;
    }
    if (rescue == kMaxEscapes || steps <= 0 ||
        !(sideways_sq(model, sheet, h) >
          kStuckSpacings * kStuckSpacings * fourth_neighbour_sq(model, end.place)))
      break;
    std::uint32_t better = end.place;
    double nearest = end.distance_sq_mm2;
    for (const std::uint32_t first : model.neighbours[end.place])
      for (const std::uint32_t second : model.neighbours[first]) {
        const double d = points::distance_sq(model.points[second], h);
        if (d < nearest) {
          nearest = d;
          better = second;
        }
      }
    if (better == end.place) break;
    ++counters.local_minima;
    end = points::walk(model, better, h, steps, [](std::uint32_t) {});
  }
  sheet.distance_sq_mm2 = end.distance_sq_mm2;
  sheet.walk_truncated = steps == 0;
  counters.walk_steps += static_cast<std::uint64_t>(before - steps);
  return end;
}

/// Two neighbours whose facet with the god object encloses the HIP's projection, as far as eight neighbours
/// allow: the nearest to the HIP, then the nearest on the HIP's side of the line to the first. Unlike the
/// printed shading's two nearest they are never collinear with the god object.
[[nodiscard]] inline points::NearestTwo enclosing_two(const points::PointModel& model,
                                                      const points::WalkResult& end, const Vec3& outward,
                                                      const Vec3& h) noexcept {
  const points::NearestTwo two = points::nearest_two(model, end);
  const Vec3 g = model.points[end.place].at();
  const Vec3 along = model.points[two.first].at() - g;
  const Vec3 across = outward.cross(along);  // in the surface, perpendicular to the line
  const double side = across.dot(h - g);
  const double least = kMinFacetSine * kMinFacetSine * across.squaredNorm();
  const double turn = side < 0.0 ? -1.0 : 1.0;
  const double ax = turn * across.x(), ay = turn * across.y(), az = turn * across.z();
  const double gx = g.x(), gy = g.y(), gz = g.z();
  double aside[search::kNeighbours], enough[search::kNeighbours];
  for (std::size_t k = 0; k < search::kNeighbours; ++k) {
    const double dx = end.x_mm[k] - gx, dy = end.y_mm[k] - gy, dz = end.z_mm[k] - gz;
    aside[k] = ax * dx + ay * dy + az * dz;
    enough[k] = least * (dx * dx + dy * dy + dz * dz);
  }
  // aside^2 = |across|^2 |step|^2 cos^2; points on or behind the line do not count. Branch-free, because the
  // outcome varies between frames.
  std::uint64_t nearest = points::kNoKey;
  for (std::size_t k = 0; k < search::kNeighbours; ++k) {
    const bool counts = (aside[k] > 0.0) & (aside[k] * aside[k] >= enough[k]);
    nearest = std::min(nearest, points::order_key(end.neighbour_sq_mm2[k], k) | (std::uint64_t{counts} - 1));
  }
  const search::Neighbours& around = model.neighbours[end.place];
  return {two.first, nearest == points::kNoKey ? two.second : around[nearest & 7u]};
}

/// A facet turned from its point's plane by less than this sine (3.6 degrees) stands for the whole surface:
/// the force error is below the 7 % that a hand notices.
inline constexpr double kCreaseSine = 1.0 / 16.0;

/// True if a facet is at a crease of the sheet. Scale free.
[[nodiscard]] inline bool at_crease(const FacetPlane& plane, const Vec3& outward) noexcept {
  const double along = plane.scaled_normal.dot(outward);
  return along * along < (1.0 - kCreaseSine * kCreaseSine) * plane.area_sq;
}

/// True if the projection of r on a facet's plane is beside the facet, beyond the line to corner b or c; all
/// relative to its first corner.
[[nodiscard]] inline bool beside(const FacetPlane& plane, const Vec3& b, const Vec3& c,
                                 const Vec3& r) noexcept {
  return plane.scaled_normal.dot(b.cross(r)) < 0.0 || plane.scaled_normal.dot(c.cross(r)) > 0.0;
}

/// The vector from `h` to the nearest place on the fan of facets between the walk's end and its neighbours,
/// each extended outward: a facet, a line between two, or the point. In grooves and corners it is the
/// constraint solution of Zilles and Salisbury (1995), continuous in h. Returns `pull` if the neighbours do
/// not surround the point. At most eight facets and lines; allocates nothing.
[[nodiscard]] Vec3 pull_at_crease(const points::PointModel& model, const points::WalkResult& end,
                                  const Vec3& outward, const Vec3& h, const Vec3& pull) noexcept;

}  // namespace palpate::baselines::vertices
