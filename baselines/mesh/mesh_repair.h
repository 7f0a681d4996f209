// Examines, repairs, smooths and decimates meshes, with OpenMesh. A SurfaceMesh is examined; plain meshes
// (mm, any frame) are changed: vertices at one place are merged. Deterministic, one thread.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

/// An open component of fewer faces is a shard: the smallest real parts of a scan have thousands.
inline constexpr std::size_t kFewFaces = 100;
/// Fewer shards than this may be a model of plain sheets.
inline constexpr std::size_t kManyShards = 10;

struct MeshReport {
  std::size_t vertices = 0;    ///< after welding
  std::size_t faces = 0;       ///< accepted by OpenMesh
  std::size_t components = 0;  ///< connected over edges with any number of faces
  /// Faces in shards, if there are kManyShards; a god object falls off them.
  std::size_t shattered_faces = 0;
  std::size_t boundary_edges = 0;
  std::size_t boundary_loops = 0;
  std::size_t refused_faces =
      0;  ///< at complex edges or corners, which half-edges cannot represent; still rendered
  std::size_t isolated_vertices = 0;  ///< in no face
  bool closed = false;                ///< no boundary, no refused face
};

/// O(facets). Not for frames. Temporarily about 200 bytes a facet.
[[nodiscard]] MeshReport report_on(const SurfaceMesh& mesh);

/// Lines for PrepareReport::notes: counts from building the mesh, and from `report` unless null.
[[nodiscard]] std::vector<std::string> describe(const SurfaceMesh& mesh, const MeshReport* report);

/// Warnings with remedies for PrepareReport::warnings if forces on a point are unreliable. `report` (or null)
/// gives shards, `folded` the facets that cross others of their component. `repaired`: do not propose repair.
[[nodiscard]] std::vector<std::string> mesh_warnings(const SurfaceMesh& mesh, const MeshReport* report,
                                                     std::size_t folded, bool repaired);

struct RepairReport {
  std::size_t welded = 0;   ///< repeated vertices merged
  std::size_t dropped = 0;  ///< facets with two corners at one place
  std::size_t flipped = 0;  ///< facets reoriented to their neighbours
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
