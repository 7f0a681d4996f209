// Smooth subdivision of triangle meshes.
#pragma once

#include <palpate/triangle_mesh.h>
#include <palpate/vec.h>

namespace palpate::geometry {

/// One step of Loop subdivision (1987, weights of Warren 1995): each triangle becomes four, old vertices
/// move, every edge gets a vertex. Edges without exactly two triangles, and their ends, follow border rules;
/// facets that repeat a vertex are dropped. Vertices are distinguished by index, so weld first. O(n log n).
[[nodiscard]] TriangleMesh loop_subdivided(const TriangleMesh& mesh);

/// Merges vertices at bit-identical places, in order of the first; drops facets that lose a corner. O(n log
/// n).
[[nodiscard]] TriangleMesh welded(const TriangleMesh& mesh);

/// Weight of the ends' tangent difference in the middle of a cubic Hermite segment.
inline constexpr double kHermiteMidpointWeight = 0.125;

/// The middle of the curve that leaves both ends along their planes. Normals are unit, or zero for none.
[[nodiscard]] inline Vec3 hermite_midpoint(const Vec3& a, const Vec3& b, const Vec3& normal_a,
                                           const Vec3& normal_b) noexcept {
  const Vec3 chord = b - a;
  const Vec3 middle = 0.5 * (a + b);
  if (normal_a == Vec3::Zero() || normal_b == Vec3::Zero()) return middle;
  const Vec3 along_a = chord - normal_a * normal_a.dot(chord);
  const Vec3 along_b = chord - normal_b * normal_b.dot(chord);
  return middle + kHermiteMidpointWeight * (along_a - along_b);
}

}  // namespace palpate::geometry
