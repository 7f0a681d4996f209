// The god object on a star mesh: it only ever descends in its distance to the HIP, over facets, edges and
// corners, so that no energy is made whatever the surface is (it is the envelope theorem: on one facet the
// force is the gradient of the stored energy, and a change of facet only lowers it).
#pragma once

#include <cstdint>

#include "toolkit/core/tolerances.h"
#include "toolkit/stars/facet.h"

namespace palpate::stars {

/// Facets that a frame may move over, each with its neighbours looked at. At 1 mm a frame and points 0.05 mm
/// apart some 40 are needed; what is left is done in the next frame.
inline constexpr int kMaxFacetMoves = 256;
/// A move must shorten the squared distance by more than its rounding: the difference, three squares and two
/// sums.
inline constexpr double kDescent = 1.0 - 8.0 * kUnitRoundoff;

/// Where the god object stands.
struct Stand {
  Facet facet;
  Foot foot;
};

/// Moves `stand` over the mesh to the local minimum of the distance to h. False where `moves` ran out.
inline bool descend(const StarMesh& mesh, const Vec3& h, Stand& stand, int& moves) noexcept {
  stand.foot = foot_on(stand.facet, h);
  while (stand.foot.feature != Feature::kInside) {
    if (moves == 0) return false;
    --moves;
    const double to_beat = stand.foot.distance_sq * kDescent;
    const std::uint32_t k = number_of(stand.foot.feature);
    std::array<std::uint32_t, 3> best{};
    Foot nearest;
    nearest.distance_sq = to_beat;
    if (is_edge(stand.foot.feature)) {
      const Facet other = across(mesh, stand.facet, k);
      if (other.place[0] == kNoPlace) return true;
      const Foot foot = foot_on(other, h);
      if (foot.distance_sq < nearest.distance_sq) {
        nearest = foot;
        best = other.place;
      }
    } else {
      const std::uint32_t at = stand.facet.place[k];
      const Ring ring = mesh.ring(at);
      for (std::uint32_t s = 0; s < ring.size; ++s) {
        if (!ring.has_sector(s)) continue;
        const Facet other(mesh, at, ring.of[s], ring.of[ring.next(s)]);
        const Foot foot = foot_on(other, h);
        if (foot.distance_sq < nearest.distance_sq) {
          nearest = foot;
          best = other.place;
        }
      }
    }
    if (!(nearest.distance_sq < to_beat)) return true;
    stand.facet = Facet(mesh, best[0], best[1], best[2]);
    stand.foot = nearest;
  }
  return true;
}

/// What a place is at rest in front of or behind: `height` above 0 where h is outside, below where it is
/// inside, by the pseudonormal of the feature (Baerentzen and Aanaes 2005). `border`: the foot is on an edge
/// that only one facet has.
struct Side {
  double height = 0.0;
  bool border = false;
  Vec3 area = Vec3::Zero();  ///< of the facets around: square to what they stand on, whatever spike they make
};
[[nodiscard]] Side side_of(const StarMesh& mesh, const Stand& stand, const Vec3& h) noexcept;

/// Which way the surface faces around a facet, whatever single facets do: the sum of the area normals of all
/// that stand at its corners, or with `wide` at the points around those too, and its length as a share of
/// their area: 1 on a plane, 0 where as much faces one way as the other. Up to 18, and 150, of random points.
struct Trend {
  Vec3 normal = Vec3::Zero();
  double share = 0.0;
};
[[nodiscard]] Trend trend_around(const StarMesh& mesh, const Facet& facet, bool wide) noexcept;

/// How far h is past the border that the foot is on, squared: sideways, as a surface of normal n lies.
[[nodiscard]] inline double past_border_sq(const Stand& stand, const Vec3& n, const Vec3& h) noexcept {
  const Vec3 r = h - stand.foot.point;
  const double square = n.squaredNorm();
  return square > 0.0 ? (r - n * (n.dot(r) / square)).squaredNorm() : r.squaredNorm();
}

/// Of the triangles around a place, outward; the sum of their areas' normals, each twice the area long.
[[nodiscard]] inline Vec3 area_normal_around(const StarMesh& mesh, std::uint32_t place) noexcept {
  const Ring ring = mesh.ring(place);
  Vec3 sum = Vec3::Zero();
  for (std::uint32_t k = 0; k < ring.size; ++k)
    if (ring.has_sector(k)) sum += Facet(mesh, place, ring.of[k], ring.of[ring.next(k)]).area_normal();
  return sum;
}

/// On a smooth surface no pull leans by more than 11 degrees from the facets that it stands on: the square of
/// that angle's cosine.
inline constexpr double kSmoothShare = 0.96;
/// Whether a pull's cosine with a normal, squared, is below a share.
[[nodiscard]] inline bool leans(const Vec3& normal, const Vec3& pull, double share) noexcept {
  const double along = normal.dot(pull);
  return !(along > 0.0 && along * along > share * normal.squaredNorm() * pull.squaredNorm());
}

/// Whether the place nearest to h of two facets that h is behind is on the edge between them, from a to b,
/// and where: the way there. `around`: the sum of the facets' normals, towards the touched side. A pull that
/// leans from that may hang on something, and is none.
[[nodiscard]] inline bool rests_on_edge(const Vec3& h, const Vec3& a, const Vec3& b, const Vec3& around,
                                        Vec3& pull) noexcept {
  const Vec3 along = b - a;
  const double share = along.dot(h - a), square = along.squaredNorm();
  if (!(share > 0.0 && share < square)) return false;
  pull = a + along * (share / square) - h;
  return !leans(around, pull, kSmoothShare);
}

/// visit(facet) for the facets that meet where the stand's foot is; its own first.
template <class Visit>
void for_facets_at(const StarMesh& mesh, const Stand& stand, Visit&& visit) noexcept {
  visit(stand.facet);
  if (stand.foot.feature == Feature::kInside) return;
  const std::uint32_t k = number_of(stand.foot.feature);
  if (is_edge(stand.foot.feature)) {
    const Facet other = across(mesh, stand.facet, k);
    if (other.place[0] != kNoPlace) visit(other);
    return;
  }
  const std::uint32_t at = stand.facet.place[k];
  const Ring ring = mesh.ring(at);
  for (std::uint32_t s = 0; s < ring.size; ++s)
    if (ring.has_sector(s) && ring.of[s] != stand.facet.place[corner_after(k)])
      visit(Facet(mesh, at, ring.of[s], ring.of[ring.next(s)]));
}

}  // namespace palpate::stars
