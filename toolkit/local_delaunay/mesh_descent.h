// Descent of the god object over facets, edges and corners. Its distance to the HIP only falls. It creates no
// energy on any surface: on one facet the force is the gradient of the stored energy, and a change of facet
// only lowers that energy (envelope theorem).
#pragma once

#include <cstdint>

#include "toolkit/core/tolerances.h"
#include "toolkit/local_delaunay/facet.h"

namespace palpate::local_delaunay {

/// Most facets moved over in a frame, neighbours included. At 1 mm a frame and points 0.05 mm apart some 40
/// are needed; the rest waits for the next frame.
inline constexpr int kMaxFacetMoves = 256;
/// A move must shorten the squared distance by more than its rounding: a difference, three squares, two sums.
inline constexpr double kDescent = 1.0 - 8.0 * kUnitRoundoff;

/// The god object's position.
struct SurfacePosition {
  Facet facet;
  ClosestPoint closest;
};

/// Moves `stand` to the local minimum of the distance to h. False if `moves` ran out.
inline bool descend(const LocalDelaunayMesh& mesh, const Vec3& h, SurfacePosition& position,
                    int& moves) noexcept {
  position.closest = closest_point_on(position.facet, h);
  while (position.closest.feature != Feature::kInside) {
    if (moves == 0) return false;
    --moves;
    const double to_beat = position.closest.distance_sq * kDescent;
    const std::uint32_t k = feature_index(position.closest.feature);
    std::array<std::uint32_t, 3> best{};
    ClosestPoint nearest;
    nearest.distance_sq = to_beat;
    if (is_edge(position.closest.feature)) {
      const Facet other = across(mesh, position.facet, k);
      if (other.place[0] == kNoPlace) return true;
      const ClosestPoint closest = closest_point_on(other, h);
      if (closest.distance_sq < nearest.distance_sq) {
        nearest = closest;
        best = other.place;
      }
    } else {
      const std::uint32_t at = position.facet.place[k];
      const Ring ring = mesh.ring(at);
      for (std::uint32_t s = 0; s < ring.size; ++s) {
        if (!ring.has_sector(s)) continue;
        const Facet other(mesh, at, ring.of[s], ring.of[ring.next(s)]);
        const ClosestPoint closest = closest_point_on(other, h);
        if (closest.distance_sq < nearest.distance_sq) {
          nearest = closest;
          best = other.place;
        }
      }
    }
    if (!(nearest.distance_sq < to_beat)) return true;
    position.facet = Facet(mesh, best[0], best[1], best[2]);
    position.closest = nearest;
  }
  return true;
}

/// The side of h relative to its place at rest: `height` is above 0 outside and below 0 inside, by the
/// feature's pseudonormal (Baerentzen and Aanaes 2005). `border`: the closest point is on an edge with one
/// facet.
struct Side {
  double height = 0.0;
  bool border = false;
  Vec3 area = Vec3::Zero();  ///< summed over the facets around; robust against spikes
};
[[nodiscard]] Side side_of(const LocalDelaunayMesh& mesh, const SurfacePosition& position,
                           const Vec3& h) noexcept;

/// The mean direction of the surface around a facet, robust against single facets: the sum of area normals at
/// its corners (with `wide` also at the points around), and its length relative to the area: 1 on a plane, 0
/// if facets cancel. Up to 18 (wide: 150) random facets.
struct MeanOrientation {
  Vec3 normal = Vec3::Zero();
  double share = 0.0;
};
[[nodiscard]] MeanOrientation mean_orientation_around(const LocalDelaunayMesh& mesh, const Facet& facet,
                                                      bool wide) noexcept;

/// Squared distance of h past the border that the closest point is on, sideways on a surface of normal n.
[[nodiscard]] inline double past_border_sq(const SurfacePosition& position, const Vec3& n,
                                           const Vec3& h) noexcept {
  const Vec3 r = h - position.closest.point;
  const double square = n.squaredNorm();
  return square > 0.0 ? (r - n * (n.dot(r) / square)).squaredNorm() : r.squaredNorm();
}

/// The sum of area normals of the triangles around a place, outward, each twice the area long.
[[nodiscard]] inline Vec3 area_normal_around(const LocalDelaunayMesh& mesh, std::uint32_t place) noexcept {
  const Ring ring = mesh.ring(place);
  Vec3 sum = Vec3::Zero();
  for (std::uint32_t k = 0; k < ring.size; ++k)
    if (ring.has_sector(k)) sum += Facet(mesh, place, ring.of[k], ring.of[ring.next(k)]).area_normal();
  return sum;
}

/// cos^2 of 11 degrees: on a smooth surface no pull leans more from its facets.
inline constexpr double kSmoothShare = 0.96;
/// True if the squared cosine of a pull with a normal is below a share.
[[nodiscard]] inline bool tilts_beyond(const Vec3& normal, const Vec3& pull, double share) noexcept {
  const double along = normal.dot(pull);
  return !(along > 0.0 && along * along > share * normal.squaredNorm() * pull.squaredNorm());
}

/// True, with the way there, if h's nearest place on two facets that it is behind lies on their edge a b.
/// `around`: sum of the facet normals, towards the touched side; a pull that leans from it may be stuck and
/// is refused.
[[nodiscard]] inline bool rests_on_edge(const Vec3& h, const Vec3& a, const Vec3& b, const Vec3& around,
                                        Vec3& pull) noexcept {
  const Vec3 along = b - a;
  const double share = along.dot(h - a), square = along.squaredNorm();
  if (!(share > 0.0 && share < square)) return false;
  pull = a + along * (share / square) - h;
  return !tilts_beyond(around, pull, kSmoothShare);
}

/// Calls visit(facet) for the facets at the closest point, its own first.
template <class Visit>
void for_facets_at(const LocalDelaunayMesh& mesh, const SurfacePosition& position, Visit&& visit) noexcept {
  visit(position.facet);
  if (position.closest.feature == Feature::kInside) return;
  const std::uint32_t k = feature_index(position.closest.feature);
  if (is_edge(position.closest.feature)) {
    const Facet other = across(mesh, position.facet, k);
    if (other.place[0] != kNoPlace) visit(other);
    return;
  }
  const std::uint32_t at = position.facet.place[k];
  const Ring ring = mesh.ring(at);
  for (std::uint32_t s = 0; s < ring.size; ++s)
    if (ring.has_sector(s) && ring.of[s] != position.facet.place[next_corner(k)])
      visit(Facet(mesh, at, ring.of[s], ring.of[ring.next(s)]));
}

}  // namespace palpate::local_delaunay
