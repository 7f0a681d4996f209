// Examines a mesh once with OpenMesh's half-edges and reports its kind and flaws.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

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
  std::size_t flat_faces = 0;         ///< zero area
  std::size_t isolated_vertices = 0;  ///< in no face
  bool closed = false;                ///< no boundary, no refused face
};

/// O(facets). Not for frames. Temporarily about 200 bytes a facet.
[[nodiscard]] MeshReport report_on(const SurfaceMesh& mesh);

/// Lines for PrepareReport::notes: counts from building the mesh, and from `report` unless null.
[[nodiscard]] std::vector<std::string> describe(const SurfaceMesh& mesh, const MeshReport* report);

/// Warnings with remedies for PrepareReport::warnings if forces on a point are unreliable. `report` (or null)
/// gives shards, `folded` the facets that cross others of their component. `repaired`: do not propose repair.
[[nodiscard]] std::vector<std::string> doubts(const SurfaceMesh& mesh, const MeshReport* report,
                                              std::size_t folded, bool repaired);

}  // namespace palpate::baselines
