// The god object's descent over a mesh: from facet to facet, always nearer to the HIP.
#pragma once

#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

/// A place on the mesh, on one side of it.
struct MeshPoint {
  HalfFacet half = 0;
  Feature feature = kInside;
  Vec3 point = Vec3::Zero();
  double distance_sq = 0.0;
};

/// Minimises the distance to `h` over the facets connected to `at`, without leaving the side. One round looks
/// at the facet and at what is beyond the feature its closest point lies on. Where it stops no facet around
/// the feature has a closer point, which is Zilles and Salisbury's minimum with as many active planes as the
/// feature has: one inside a facet, two on a concave edge, three at a concave corner. Taking the bounded
/// facets instead of endless planes makes it exact within the facet, and nearly coplanar facets cannot wedge
/// it: each step is a strict decrease. `rounds` counts down; at 0 the walk stops where it is. step(from, to)
/// may veto a move by returning false.
template <class Step>
[[nodiscard]] inline MeshPoint descend(const SurfaceMesh& mesh, MeshPoint at, const Vec3& h, int& rounds,
                                       Step&& step) noexcept {
  FacetPoint here = closest_on_facet(mesh.facet(facet_of(at.half)), h);
  MeshPoint next{at.half, here.feature, here.point, here.distance_sq};
  if (!step(at, next)) return at;
  at = next;
  for (; rounds > 0; --rounds) {
    if (at.feature == kInside) return at;
    MeshPoint best = at;
    const auto look = [&](HalfFacet half) {
      const FacetPoint p = closest_on_facet(mesh.facet(facet_of(half)), h);
      if (p.distance_sq < best.distance_sq) best = {half, p.feature, p.point, p.distance_sq};
    };
    if (at.feature < kCorner) {
      const HalfFacet other = mesh.neighbour(at.half, static_cast<std::uint32_t>(at.feature - kEdge));
      if (other == kNoFacet) return at;
      look(other);
    } else {
      mesh.around_corner(at.half, static_cast<std::uint32_t>(at.feature - kCorner), look);
    }
    if (!(best.distance_sq < at.distance_sq)) return at;
    if (!step(at, best)) return at;
    at = best;
  }
  return at;
}

}  // namespace palpate::baselines
