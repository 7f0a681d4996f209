// A box tree over facets in double: the reference's own index, apart from Embree.
#pragma once

#include <cstdint>
#include <vector>

#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

/// Immutable after building; queries safe from many threads. Coordinates relative to the mesh's origin.
class BoxTree {
 public:
  explicit BoxTree(const SurfaceMesh& mesh);

  struct Nearest {
    std::uint32_t facet = kNoFacet;
    FacetPoint point;
  };
  /// The closest point of the whole mesh, exact up to double rounding; ties go to the lowest facet. O(log n)
  /// as a rule.
  [[nodiscard]] Nearest closest(const Vec3& p) const;

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
  struct Node {
    geometry::Aabb box;
    std::uint32_t begin = 0, end = 0;  ///< facets of a leaf in order_
    std::uint32_t right = 0;           ///< second child of an inner node, the first follows; 0 in a leaf
  };
  std::uint32_t build(std::uint32_t begin, std::uint32_t end, const std::vector<Vec3>& centres);

  const SurfaceMesh* mesh_;
  std::vector<Node> nodes_;
  std::vector<std::uint32_t> order_;
};

}  // namespace palpate::baselines
