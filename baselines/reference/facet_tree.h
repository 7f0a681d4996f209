// A box tree over facets, independent of Embree. In double, it answers whether a frictionless proxy may rest
// where it does, and how far a mesh is from the points it was made from.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/result.h>
#include "baselines/mesh/surface_mesh.h"
#include "toolkit/geometry/broad_phase.h"

namespace palpate::baselines {

/// Immutable after building; concurrent queries are safe. Coordinates relative to the mesh's origin.
class FacetTree {
 public:
  explicit FacetTree(const SurfaceMesh& mesh);

  struct Nearest {
    std::uint32_t facet = kNoFacet;
    FacetPoint point;
  };
  /// Closest point of the whole mesh, exact up to double rounding; ties take the lowest facet. Usually O(log
  /// n).
  [[nodiscard]] Nearest closest(const Vec3& p) const;

  /// Adds every facet within `radius` of p, ascending.
  void within(const Vec3& p, double radius, std::vector<std::uint32_t>& facets) const;

  struct Crossing {
    std::uint32_t facet = kNoFacet;
    double fraction = 0.0;
  };
  /// First facet pierced by a -> b, rounding at its borders included. Skips facets that share a vertex with
  /// `except_vertex_of` and whose plane holds a within rounding: the way just left them.
  [[nodiscard]] Crossing first_crossing(const Vec3& a, const Vec3& b,
                                        std::uint32_t except_vertex_of = kNoFacet) const;

 private:
  const SurfaceMesh* mesh_;
  geometry::AabbTree tree_;
};

struct Rest {
  std::size_t touched = 0;  ///< distinct directions from which facets hold the proxy
  double off_rad =
      0.0;  ///< angle between the pull and the nearest pull they can bear; pi / 2 if nothing is touched
};

/// A proxy at `proxy`, a sphere of `radius` (0: a point) pulled towards `hip`, is held by facets within
/// `reach` of its skin. They push along their normals (a point), or from their nearest point to the centre (a
/// sphere). At a local minimum of the distance to the HIP such pushes add up to the pull; any other rest is a
/// jam. Relative to the mesh's origin, mm. O(log facets + touched^3); not for frames.
[[nodiscard]] Rest rest_of(const SurfaceMesh& mesh, const FacetTree& tree, const Vec3& proxy, double radius,
                           double reach, const Vec3& hip);

struct MeshDistance {
  double points_rms_mm = 0.0, points_max_mm = 0.0;  ///< from points to the mesh
  double mesh_rms_mm = 0.0, mesh_max_mm = 0.0;      ///< from places of the mesh to the nearest point
  std::size_t samples = 0;                          ///< in each direction
};

/// Uses at most `samples` points and as many places spread evenly over the mesh's area; deterministic for any
/// number of threads. A dense cloud is itself about half a spacing from places between its points. Errors: no
/// triangles, no points. O(n log n).
[[nodiscard]] Result<MeshDistance> mesh_distance(const geometry::TriangleMesh& mesh,
                                                 const cloud::Cloud& cloud, std::size_t samples, int threads);

}  // namespace palpate::baselines
