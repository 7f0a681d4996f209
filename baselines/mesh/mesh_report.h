// What kind of mesh it is: held in OpenMesh's half-edges once, looked at, and reported to people.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

/// An open component of fewer faces is a shard: a scan's smallest parts have thousands.
inline constexpr std::size_t kFewFaces = 100;
/// A model of a few plain sheets is none; so many shards are.
inline constexpr std::size_t kManyShards = 10;

struct MeshReport {
  std::size_t vertices = 0;    ///< welded
  std::size_t faces = 0;       ///< held by OpenMesh
  std::size_t components = 0;  ///< of faces connected over edges, however many meet there
  /// Faces in open components of fewer than kFewFaces, where there are many of these: what a god object falls
  /// off.
  std::size_t shattered_faces = 0;
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

/// What building the mesh counted, as lines for PrepareReport::notes, and what report_on() found beside it;
/// `report` is null where nobody asked.
[[nodiscard]] std::vector<std::string> describe(const SurfaceMesh& mesh, const MeshReport* report);

/// Why forces on the mesh of a point are not to be trusted, each with its remedy, for
/// PrepareReport::warnings; nothing where they are. What is seen of a mesh depends on what was looked for:
/// shards in `report` (or null), folds in `folded`, facets that cross others of their component. `repaired`:
/// by repaired(), which is no remedy then.
[[nodiscard]] std::vector<std::string> doubts(const SurfaceMesh& mesh, const MeshReport* report,
                                              std::size_t folded, bool repaired);

}  // namespace palpate::baselines
