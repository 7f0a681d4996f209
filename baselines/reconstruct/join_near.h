// Vertices that rounding alone holds apart become one.
#pragma once

#include <cstddef>

#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::baselines {

struct Joined {
  std::size_t vertices = 0;   ///< joined with an earlier one
  std::size_t triangles = 0;  ///< gone: collapsed, or two that lie back to back
};

/// Vertices that edges no longer than `distance` connect become the first of them. Triangles that collapse
/// go, and so do pairs with the same corners the other way round, between which there is nothing. Vertices
/// are numbered anew in their order, triangles keep theirs. O(n log n). The same on every run.
Joined join_near(geometry::TriangleMesh& mesh, double distance);

}  // namespace palpate::baselines
