// The god object on a mesh: the local minimum of the distance to the HIP along the surface.
//
// Zilles and Salisbury's minimisation (1995) with active planes from the mesh's neighbourhood: at rest the
// god object is inside a facet (one plane), on a concave edge (two), or at a corner (three or more). Each
// facet is minimised within its own borders, so nearly coplanar facets form no false corners. Every move
// strictly shortens the distance, so no order of facets can cycle. Facets of other sheets across the way add
// their planes (Crossings), and the way may go on along them.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <span>

#include "baselines/mesh/surface_mesh.h"
#include "baselines/proximity/segment_index.h"
#include "toolkit/render/joint_contact.h"

namespace palpate::baselines {

/// Most facets examined per frame (a fan may be finished beyond it); the next frame continues. About 40 are
/// needed at 1 mm a frame and 0.05 mm spacing.
inline constexpr std::uint32_t kMaxFacetsPerFrame = 512;

struct SurfacePosition {
  HalfFacet half = kNoFacet;
  Feature feature = kInside;
  Vec3 point = Vec3::Zero();  ///< mm, relative to the mesh's origin
  double distance_sq = 0.0;   ///< to the HIP of the last slide
};

struct SlideCount {
  std::uint32_t looked_at = 0;  ///< facets
  std::uint32_t moves = 0;
  bool finished = true;  ///< false: bound reached
};

/// Moves `at` along the surface until no facet around it has a point nearer to `hip`. `crossings` may be
/// null.
SlideCount slide(const SurfaceMesh& mesh, const Crossings* crossings, const Vec3& hip,
                 SurfacePosition& at) noexcept;

/// Within this many wall distances a place is in front of the wall.
inline constexpr double kAtWall = 2.0;
/// Within this many wall distances a place is on an edge, as joint solutions are up to rounding.
inline constexpr double kOnEdge = 4.0;

/// Whether `other`, which crosses or touches half's facet, blocks that side: some of it is in front.
[[nodiscard]] bool in_front(const SurfaceMesh& mesh, std::uint32_t other, HalfFacet half) noexcept;

/// The first facet on the way from -> to that blocks half's side; kNoFacet if none.
[[nodiscard]] std::uint32_t first_wall(const SurfaceMesh& mesh, const Crossings& crossings, HalfFacet half,
                                       const Vec3& from, const Vec3& to, double* fraction) noexcept;

/// Closest point of half's facet to `place`, on the same side of crossing facets as `from`. `crossings` may
/// be null.
[[nodiscard]] FacetPoint closest_point_before_walls(const SurfaceMesh& mesh, const Crossings* crossings,
                                                    HalfFacet half, const Vec3& from,
                                                    const Vec3& place) noexcept;

/// Distance kept in front of facets of other sheets: above rounding, below anything felt.
[[nodiscard]] double wall_distance_mm(const SurfaceMesh& mesh) noexcept;

/// A point just off the sheet on its free side, from which the sheet is a wall for motion onto another sheet.
[[nodiscard]] Vec3 just_off(const SurfaceMesh& mesh, const SurfacePosition& at) noexcept;

/// visit(half-facet) for neighbours over the edges at `at`: the feature's, or within rounding.
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

/// visit(half-facet) for the others that meet at `at`: around its corner, or over the edges there.
template <class Visit>
void for_facets_at(const SurfaceMesh& mesh, const SurfacePosition& at, Visit&& visit) noexcept {
  if (at.feature >= kCorner)
    mesh.around_corner(at.half, static_cast<std::uint32_t>(at.feature - kCorner), visit);
  else
    for_edges_at(mesh, at, visit);
}

/// visit(half-facet) for facing sides of facets that cross or touch at.half's facet and hold at `at`.
/// `crossings` may be null.
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

/// Drops surplus planes: coplanar ones first, then those that the probe violates least. Local to the mesh,
/// mm. No allocation.
class ContactPlanes {
 public:
  /// One plane inside a facet or on a convex feature, several on a concave one or before other sheets.
  /// `crossings` may be null.
  ContactPlanes(const SurfaceMesh& mesh, const Crossings* crossings, const SurfacePosition& at,
                const Vec3& probe) noexcept;
  /// Unit, towards the free side; all through at.point.
  [[nodiscard]] std::span<const Vec3> normals() const noexcept { return {normal_.data(), size_}; }
  /// The part of a motion from here that the planes allow.
  [[nodiscard]] Vec3 allowed_motion(const Vec3& way) const noexcept;

 private:
  void add(const Vec3& normal) noexcept;

  Vec3 pull_;
  std::array<Vec3, render::kMaxPlanesPerTouch> normal_;
  std::size_t size_ = 0;
};

/// Whether another sheet is at `at`.
[[nodiscard]] bool is_on_other_sheet(const SurfaceMesh& mesh, const Crossings* crossings,
                                     const SurfacePosition& at) noexcept;

}  // namespace palpate::baselines
