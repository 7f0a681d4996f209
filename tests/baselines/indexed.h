// A mesh with its index, and its distance by brute force.
#pragma once

#include <algorithm>
#include <limits>
#include <memory>

#include "baselines/proximity/segment_index.h"
#include "tests/baselines/meshes.h"
#include "tests/toolkit/messages.h"

namespace palpate::test {

struct Indexed {
  std::unique_ptr<baselines::SurfaceMesh> mesh;
  std::unique_ptr<baselines::SegmentIndex> index;
};
inline Indexed indexed(const TriangleMesh& source) {
  Indexed made;
  made.mesh = std::make_unique<baselines::SurfaceMesh>(value_of(baselines::SurfaceMesh::build(source, 1)));
  made.index =
      std::make_unique<baselines::SegmentIndex>(value_of(baselines::SegmentIndex::build(*made.mesh, 1)));
  return made;
}

inline double least_distance_sq(const baselines::SurfaceMesh& mesh, const Vec3& p) {
  double least = std::numeric_limits<double>::infinity();
  for (const baselines::Facet& f : mesh.facets())
    least = std::min(least, baselines::closest_on_facet(f, p).distance_sq);
  return least;
}
inline double least_distance_sq(const TriangleMesh& mesh, const Vec3& p) {
  double least = std::numeric_limits<double>::infinity();
  for (const auto& t : mesh.triangles) {
    baselines::Facet f{};
    for (std::size_t i = 0; i < 3; ++i) f.corner[i] = mesh.vertices_mm[t[i]];
    least = std::min(least, baselines::closest_on_facet(f, p).distance_sq);
  }
  return least;
}

}  // namespace palpate::test
