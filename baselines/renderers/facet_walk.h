// The god object on a mesh: the local minimum of the distance to the HIP, reached along the surface.
//
// This is Zilles and Salisbury's minimisation (1995) with the active planes found from the mesh's
// neighbourhood: at rest the god object lies inside a facet (one plane), on an edge that is concave seen from
// its side (two), or at a corner (three or more). Every facet is minimised over within its own borders, so
// nearly coplanar facets cannot form the false corners that three infinite planes form. Each move strictly
// shortens the distance, so no facet order can make it cycle. Where facets of other sheets cross the way,
// their planes join in (Crossings), and the way may go on along them.
#pragma once

#include <cmath>
#include <cstdint>

#include "baselines/mesh/surface_mesh.h"
#include "baselines/proximity/crossings.h"

namespace palpate::baselines {

/// Facets looked at in one frame, at most (one fan may be finished beyond it); the rest is done in the next
/// frame. At 1 mm a frame and 0.05 mm spacing some 40 are needed.
inline constexpr std::uint32_t kMaxFacetsPerFrame = 512;

/// A point of the mesh, seen from one side.
struct SurfacePosition {
  HalfFacet half = kNoFacet;
  Feature feature = kInside;
  Vec3 point = Vec3::Zero();  ///< mm, relative to the mesh's origin
  double distance_sq = 0.0;   ///< to the HIP of the last slide
};

struct SlideCount {
  std::uint32_t looked_at = 0;  ///< facets
  std::uint32_t moves = 0;      ///< from facet to facet
  bool finished = true;         ///< false: the bound was reached
};

/// Moves `at` along the surface until no facet around it holds a point nearer to `hip`. `crossings` may be
/// null.
SlideCount slide(const SurfaceMesh& mesh, const Crossings* crossings, const Vec3& hip,
                 SurfacePosition& at) noexcept;

/// What is nearer to a wall than this many wall distances stands before it.
inline constexpr double kAtWall = 2.0;
/// A place this many wall distances from an edge is on it: joint solutions lie on edges up to rounding.
inline constexpr double kOnEdge = 4.0;

/// Whether `other`, which crosses half's facet or touches it, stands in the way on that side: where some of
/// it is in front.
[[nodiscard]] bool in_front(const SurfaceMesh& mesh, std::uint32_t other, HalfFacet half) noexcept;

/// The facet that crosses or touches half's facet, stands in front of that side, and that the way from -> to
/// pierces first; kNoFacet without one.
[[nodiscard]] std::uint32_t first_wall(const SurfaceMesh& mesh, const Crossings& crossings, HalfFacet half,
                                       const Vec3& from, const Vec3& to, double* fraction) noexcept;

/// The place of half's facet nearest to `place`, on the same side of what crosses it as `from` is.
/// `crossings` may be null.
[[nodiscard]] FacetPoint before_walls(const SurfaceMesh& mesh, const Crossings* crossings, HalfFacet half,
                                      const Vec3& from, const Vec3& place) noexcept;

/// The god object stays this far in front of a facet of another sheet: above rounding, under anything felt.
[[nodiscard]] double wall_distance_mm(const SurfaceMesh& mesh) noexcept;

/// A place on a sheet seen from its free side: from there the sheet itself is a wall like any other, to who
/// leaves it for another.
[[nodiscard]] Vec3 just_off(const SurfaceMesh& mesh, const SurfacePosition& at) noexcept;

/// visit(half-facet) for what lies over the edges that `at` is on, the feature's or one that rounding parts
/// from it.
template <class Visit>
void for_edges_at(const SurfaceMesh& mesh, const SurfacePosition& at, Visit&& visit) noexcept {
  const Facet& f = mesh.facet(facet_of(at.half));
  const double on = kOnEdge * wall_distance_mm(mesh);
  for (std::uint32_t e = 0; e < 3; ++e) {
    if (at.feature != kEdge + e && closest_on_edge(f, e, at.point).distance_sq > on * on) continue;
    const HalfFacet over = mesh.neighbour(at.half, e);
    if (over != kNoFacet && facet_of(over) != facet_of(at.half)) visit(over);
  }
}

/// visit(half-facet) for what crosses or touches at.half's facet and holds where `at` is: the sides that face
/// it. `crossings` may be null.
template <class Visit>
void walls_at(const SurfaceMesh& mesh, const Crossings* crossings, const SurfacePosition& at,
              Visit&& visit) noexcept {
  if (crossings == nullptr) return;
  const double near = kAtWall * wall_distance_mm(mesh);
  const HalfFacet here = at.half;
  const Vec3 place = at.point;
  for (const std::uint32_t wall : crossings->of(facet_of(here))) {
    const Facet& f = mesh.facet(wall);
    const double height = mesh.normal(half_facet(wall, 0)).dot(place - f.corner[0]);
    if (std::abs(height) > near || closest_on_facet(f, place).distance_sq > near * near) continue;
    if (in_front(mesh, wall, here)) visit(half_facet(wall, height < 0.0 ? 1u : 0u));
  }
}

}  // namespace palpate::baselines
