// What a closed mesh encloses.
#pragma once

#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::baselines {

/// By the divergence theorem; positive where triangles are counter-clockwise seen from outside.
inline double volume_of(const geometry::TriangleMesh& mesh) {
  double volume = 0.0;
  for (const auto& t : mesh.triangles)
    volume += mesh.vertices_mm[t[0]].dot(mesh.vertices_mm[t[1]].cross(mesh.vertices_mm[t[2]])) / 6.0;
  return volume;
}

}  // namespace palpate::baselines
