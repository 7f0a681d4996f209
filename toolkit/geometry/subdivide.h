// Smooth subdivision of triangle meshes.
#pragma once

#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::geometry {

/// Loop 1987, with the weights of Warren 1995: every triangle in four, old vertices moved, new ones on every
/// edge. Edges that do not have two triangles, and their ends, follow the rules of a border; facets that
/// repeat a vertex are left out. Vertices are told apart by number alone: weld first what should be one. O(n
/// log n).
[[nodiscard]] TriangleMesh subdivided_once(const TriangleMesh& mesh);

/// One vertex for all at one and the same place, bit for bit, in the order of the first; facets that lose a
/// corner are left out. O(n log n).
[[nodiscard]] TriangleMesh welded(const TriangleMesh& mesh);

}  // namespace palpate::geometry
