// A box tree over facets in double, independent of Embree.
#pragma once

#include <cstdint>
#include <vector>

#include "baselines/mesh/surface_mesh.h"
#include "toolkit/geometry/aabb_tree.h"

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

}  // namespace palpate::baselines
