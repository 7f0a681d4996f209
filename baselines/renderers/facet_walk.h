// The god object on a mesh: the local minimum of the distance to the HIP, reached along the surface.
//
// This is Zilles and Salisbury's minimisation (1995) with the active planes found from the mesh's
// neighbourhood: at rest the god object lies inside a facet (one plane), on an edge that is concave seen from
// its side (two), or at a corner (three or more). Every facet is minimised over within its own borders, so
// nearly coplanar facets cannot form the false corners that three infinite planes form. Each move strictly
// shortens the distance, so no facet order can make it cycle. Where facets of other sheets cross the way,
// their planes join in (Crossings), at most two at a time.
#pragma once

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

/// The facet that crosses at.half's facet and that the way from -> to pierces first; kNoFacet without one.
[[nodiscard]] std::uint32_t first_wall(const SurfaceMesh& mesh, const Crossings& crossings,
                                       std::uint32_t facet, const Vec3& from, const Vec3& to,
                                       double* fraction) noexcept;

/// The god object stays this far in front of a facet of another sheet: above rounding, under anything felt.
[[nodiscard]] double wall_distance_mm(const SurfaceMesh& mesh) noexcept;

}  // namespace palpate::baselines
