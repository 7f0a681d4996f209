// OpenMesh's half-edges in double precision. Only for .cpp files of this folder.
#pragma once

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wsign-conversion"
#pragma GCC diagnostic ignored "-Wold-style-cast"
#pragma GCC diagnostic ignored "-Wcast-qual"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wpedantic"
#pragma GCC diagnostic ignored "-Wdouble-promotion"
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#pragma GCC diagnostic pop

namespace palpate::baselines {

struct HalfEdgeTraits : OpenMesh::DefaultTraits {
  using Point = OpenMesh::Vec3d;
  using Normal = OpenMesh::Vec3d;
};
using HalfEdges = OpenMesh::TriMesh_ArrayKernelT<HalfEdgeTraits>;

/// While alive, suppresses OpenMesh's messages for refused faces.
class QuietOpenMesh {
 public:
  QuietOpenMesh() { omerr().disable(); }
  QuietOpenMesh(const QuietOpenMesh&) = delete;
  QuietOpenMesh& operator=(const QuietOpenMesh&) = delete;
  ~QuietOpenMesh() { omerr().enable(); }
};

}  // namespace palpate::baselines
