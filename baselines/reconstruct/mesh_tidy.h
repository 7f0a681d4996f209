// What a reconstruction library leaves to do on its triangles: one order and orientation whatever its own,
// and vertices merged that only rounding separates.
#pragma once

#include <cstddef>

#include <palpate/triangle_mesh.h>

namespace palpate::baselines {

/// Rotates triangles to start at their lowest vertex, sorts them, and flips edge-connected pieces so that the
/// first triangle's second vertex is below its third. Keeps orientedness. For libraries whose result depends
/// on memory addresses. Indices must be in range. O(n) for bounded degree, at worst O(n log n); the same for
/// any `threads` (0: all).
void fix_order(geometry::TriangleMesh& mesh, int threads = 0);

struct WeldCounts {
  std::size_t vertices = 0;   ///< merged with an earlier one
  std::size_t triangles = 0;  ///< removed: collapsed, or paired back to back
};

/// Merges vertices connected by edges up to `distance` into the first. Removes collapsed triangles and pairs
/// with equal corners and opposite orientation. Keeps the order of vertices and triangles. O(n log n).
/// Deterministic.
WeldCounts weld_vertices(geometry::TriangleMesh& mesh, double distance);

}  // namespace palpate::baselines
