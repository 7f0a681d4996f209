// A box tree over facets in double: the reference's own index, apart from Embree.
#pragma once

#include <cstdint>
#include <vector>

#include "baselines/mesh/surface_mesh.h"
#include "toolkit/geometry/box_tree.h"

namespace palpate::baselines {

/// Immutable after building; queries safe from many threads. Coordinates relative to the mesh's origin.
class FacetTree {
 public:
  explicit FacetTree(const SurfaceMesh& mesh);

  struct Nearest {
    std::uint32_t facet = kNoFacet;
    FacetPoint point;
  };
  /// The closest point of the whole mesh, exact up to double rounding; ties go to the lowest facet. O(log n)
  /// as a rule.
  [[nodiscard]] Nearest closest(const Vec3& p) const;

  /// Adds every facet that lies within `radius` of p, ascending.
  void within(const Vec3& p, double radius, std::vector<std::uint32_t>& facets) const;

  struct Crossing {
    std::uint32_t facet = kNoFacet;
    double fraction = 0.0;
  };
  /// The first facet that a -> b pierces, within rounding of its borders too. Facets that share a vertex
  /// with `except_vertex_of` are passed over where a lies on their plane within rounding: the way has just
  /// left them.
  [[nodiscard]] Crossing first_crossing(const Vec3& a, const Vec3& b,
                                        std::uint32_t except_vertex_of = kNoFacet) const;

 private:
  const SurfaceMesh* mesh_;
  geometry::BoxTree tree_;
};

}  // namespace palpate::baselines
