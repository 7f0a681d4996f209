// One order and one orientation for the triangles of a reconstruction, whatever order its library found them
// in.
#pragma once

#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::baselines {

/// Triangles start at their lowest vertex and stand in ascending order; each piece that is connected by edges
/// is turned over, where needed, so that its first triangle's second vertex is below its third. A mesh that
/// is oriented stays so. For libraries whose order or orientation follows where things lie in memory. Every
/// index in range. O(n) for vertices of bounded degree, O(n log n) at worst; on `threads` (0: all), the same
/// for any number of them.
void fix_order(geometry::TriangleMesh& mesh, int threads = 0);

}  // namespace palpate::baselines
