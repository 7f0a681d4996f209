#include "baselines/mesh/mesh_report.h"

#include <fmt/format.h>

#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Core/Utils/vector_cast.hh>
#include <vector>

namespace palpate::baselines {
namespace {

struct DoubleTraits : OpenMesh::DefaultTraits {
  using Point = OpenMesh::Vec3d;
};
using HalfEdgeMesh = OpenMesh::TriMesh_ArrayKernelT<DoubleTraits>;

std::size_t count_components(const HalfEdgeMesh& mesh) {
  std::vector<char> seen(mesh.n_faces(), 0);
  std::vector<OpenMesh::FaceHandle> open;
  std::size_t components = 0;
  for (const auto first : mesh.faces()) {
    if (seen[static_cast<std::size_t>(first.idx())] != 0) continue;
    ++components;
    open.assign(1, first);
    seen[static_cast<std::size_t>(first.idx())] = 1;
    while (!open.empty()) {
      const auto face = open.back();
      open.pop_back();
      for (auto other = mesh.cff_iter(face); other.is_valid(); ++other) {
        char& mark = seen[static_cast<std::size_t>(other->idx())];
        if (mark == 0) {
          mark = 1;
          open.push_back(*other);
        }
      }
    }
  }
  return components;
}

std::size_t count_loops(const HalfEdgeMesh& mesh) {
  std::vector<char> seen(mesh.n_halfedges(), 0);
  std::size_t loops = 0;
  for (const auto start : mesh.halfedges()) {
    if (!mesh.is_boundary(start) || seen[static_cast<std::size_t>(start.idx())] != 0) continue;
    ++loops;
    OpenMesh::HalfedgeHandle at = start;
    do {
      seen[static_cast<std::size_t>(at.idx())] = 1;
      at = mesh.next_halfedge_handle(at);
    } while (at != start && seen[static_cast<std::size_t>(at.idx())] == 0);
  }
  return loops;
}

}  // namespace

std::string MeshReport::text() const {
  return fmt::format(
      "mesh: {} vertices, {} faces, {} component(s), {}, {} faces not manifold, {} isolated vertices",
      vertices, faces, components,
      boundary_edges == 0 ? std::string("no boundary")
                          : fmt::format("{} boundary edges in {} loops", boundary_edges, boundary_loops),
      refused_faces, isolated_vertices);
}

MeshReport check_mesh(const geometry::TriangleMesh& mesh) {
  HalfEdgeMesh held;
  held.reserve(mesh.vertices_mm.size(), mesh.triangles.size() * 3 / 2, mesh.triangles.size());
  std::vector<OpenMesh::VertexHandle> handles;
  handles.reserve(mesh.vertices_mm.size());
  for (const Vec3& v : mesh.vertices_mm)
    handles.push_back(held.add_vertex(OpenMesh::Vec3d(v.x(), v.y(), v.z())));
  MeshReport report;
  ::omerr().disable();  // it prints every refused face; they are counted instead
  for (const auto& t : mesh.triangles) {
    const bool collapsed = t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
    if (collapsed || !held.add_face(handles[t[0]], handles[t[1]], handles[t[2]]).is_valid())
      ++report.refused_faces;
  }
  ::omerr().enable();
  report.vertices = held.n_vertices();
  report.faces = held.n_faces();
  for (const auto edge : held.edges()) report.boundary_edges += held.is_boundary(edge);
  for (const auto vertex : held.vertices()) report.isolated_vertices += held.is_isolated(vertex);
  report.components = count_components(held);
  report.boundary_loops = count_loops(held);
  return report;
}

}  // namespace palpate::baselines
