// How far a mesh and the points it was made from are apart.
#pragma once

#include <cstdint>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::baselines {

struct MeshDistance {
  double points_rms_mm = 0.0, points_max_mm = 0.0;  ///< from points to the nearest place of the mesh
  double mesh_rms_mm = 0.0, mesh_max_mm = 0.0;      ///< from places of the mesh to the nearest point
  std::size_t samples = 0;                          ///< either way
};

/// Over at most `samples` points and as many places of the mesh, spread evenly over its area; the same on
/// every run and for any number of threads. A dense cloud is itself about half a spacing from places between
/// its points. Errors: no triangles, no points. O(n log n).
[[nodiscard]] Result<MeshDistance> mesh_distance(const geometry::TriangleMesh& mesh,
                                                 const cloud::Cloud& cloud, std::size_t samples, int threads);

}  // namespace palpate::baselines
