// Distance between a mesh and the points it was made from.
#pragma once

#include <cstdint>

#include <palpate/cloud.h>
#include <palpate/result.h>
#include <palpate/triangle_mesh.h>

namespace palpate::baselines {

struct MeshDistance {
  double points_rms_mm = 0.0, points_max_mm = 0.0;  ///< from points to the mesh
  double mesh_rms_mm = 0.0, mesh_max_mm = 0.0;      ///< from places of the mesh to the nearest point
  std::size_t samples = 0;                          ///< in each direction
};

/// Uses at most `samples` points and as many places spread evenly over the mesh's area; deterministic for any
/// number of threads. A dense cloud is itself about half a spacing from places between its points. Errors: no
/// triangles, no points. O(n log n).
[[nodiscard]] Result<MeshDistance> mesh_distance(const geometry::TriangleMesh& mesh,
                                                 const cloud::Cloud& cloud, std::size_t samples, int threads);

}  // namespace palpate::baselines
