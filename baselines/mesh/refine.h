// What a mesh pipeline does to a mesh before it is rendered: repair, smoothing, decimation, by OpenMesh. All
// take and give plain meshes, in mm of any frame; vertices at one place are one. Deterministic, one thread.
#pragma once

#include <cstddef>

#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::baselines {

struct RepairReport {
  std::size_t welded = 0;   ///< repeated vertices made one
  std::size_t dropped = 0;  ///< facets with two corners at one place
  std::size_t turned = 0;   ///< facets turned to agree with their neighbours
  std::size_t cut = 0;      ///< facets at edges or corners of too many, given corners of their own
  std::size_t filled_holes = 0, filled_facets = 0;
  std::size_t left_loops = 0;  ///< boundary loops with more edges, or that no facets fit into
};

/// Makes a mesh that is oriented, manifold and without small holes. Boundary loops of up to `max_hole_edges`
/// are filled with the triangulation of least area (Barequet and Sharir 1995), no new vertices; larger ones
/// are taken for the rim of an open surface. No facet but those is lost. O(n log n + holes x edges^3).
[[nodiscard]] Result<geometry::TriangleMesh> repaired(const geometry::TriangleMesh& mesh,
                                                      std::size_t max_hole_edges,
                                                      RepairReport* report = nullptr);

/// Edges collapsed in the order of their quadric error (Garland and Heckbert 1997, OpenMesh's decimater)
/// until `share` of the facets is left, or nothing more collapses without turning a facet over. O(n log n),
/// some 6 us a facet.
[[nodiscard]] Result<geometry::TriangleMesh> decimated(const geometry::TriangleMesh& mesh, double share);

/// OpenMesh's Laplace smoothing of second order (Jacobi, tangential and normal), which shrinks less than the
/// first; the rim and its ring stay. O(n x iterations).
[[nodiscard]] Result<geometry::TriangleMesh> smoothed(const geometry::TriangleMesh& mesh, int iterations);

}  // namespace palpate::baselines
