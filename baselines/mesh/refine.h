// Repairs, smooths and decimates meshes before rendering, by OpenMesh. Plain meshes, mm, any frame; vertices
// at one place are merged. Deterministic, one thread.
#pragma once

#include <cstddef>

#include <palpate/result.h>
#include <palpate/triangle_mesh.h>

namespace palpate::baselines {

struct RepairReport {
  std::size_t welded = 0;   ///< repeated vertices merged
  std::size_t dropped = 0;  ///< facets with two corners at one place
  std::size_t turned = 0;   ///< facets reoriented to their neighbours
  std::size_t cut = 0;      ///< facets at complex edges or corners, given corners of their own
  std::size_t filled_holes = 0, filled_facets = 0;
  std::size_t left_loops = 0;  ///< boundary loops too long, or without a valid filling
};

/// Orients a mesh, makes it manifold and fills small holes. Boundary loops of up to `max_hole_edges` get the
/// least-area triangulation (Barequet and Sharir 1995) without new vertices; longer ones are rims of an open
/// surface. Only welding drops facets. O(n log n + holes x edges^3).
[[nodiscard]] Result<geometry::TriangleMesh> repaired(const geometry::TriangleMesh& mesh,
                                                      std::size_t max_hole_edges,
                                                      RepairReport* report = nullptr);

/// Collapses edges by quadric error (Garland and Heckbert 1997, OpenMesh's decimater) until `share` of the
/// facets is left or every collapse would flip one. O(n log n), about 6 us a facet.
[[nodiscard]] Result<geometry::TriangleMesh> decimated(const geometry::TriangleMesh& mesh, double share);

/// OpenMesh's second-order Laplace smoothing (Jacobi, tangential and normal), which shrinks less than first
/// order; keeps the rim and its ring. O(n x iterations).
[[nodiscard]] Result<geometry::TriangleMesh> smoothed(const geometry::TriangleMesh& mesh, int iterations);

}  // namespace palpate::baselines
