// What kind of mesh it is: held in OpenMesh's half-edges once, looked at, and reported to people.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

struct MeshReport {
  std::size_t vertices = 0;    ///< welded
  std::size_t faces = 0;       ///< held by OpenMesh
  std::size_t components = 0;  ///< of faces connected over edges
  std::size_t boundary_edges = 0;
  std::size_t boundary_loops = 0;
  std::size_t refused_faces =
      0;                       ///< at complex edges or corners, which half-edges cannot hold; still rendered
  std::size_t flat_faces = 0;  ///< without area
  std::size_t isolated_vertices = 0;  ///< in no face
  bool closed = false;                ///< no boundary, nothing refused
};

/// O(facets). Not on the frame path; memory some 200 bytes a facet, given back at the end.
[[nodiscard]] MeshReport report_on(const SurfaceMesh& mesh);

/// The report and the counts of welding as lines for PrepareReport::notes.
[[nodiscard]] std::vector<std::string> describe(const MeshReport& report, const SurfaceMeshCounts& counts);

}  // namespace palpate::baselines
