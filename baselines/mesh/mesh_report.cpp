#include "baselines/mesh/mesh_report.h"

#include <fmt/format.h>

#include "baselines/mesh/half_edges.h"

namespace palpate::baselines {
namespace {

std::size_t count_components(const HalfEdges& mesh) {
  std::vector<bool> seen(mesh.n_faces(), false);
  std::vector<OpenMesh::FaceHandle> open;
  std::size_t components = 0;
  for (const OpenMesh::FaceHandle start : mesh.faces()) {
    if (seen[static_cast<std::size_t>(start.idx())]) continue;
    ++components;
    seen[static_cast<std::size_t>(start.idx())] = true;
    open.push_back(start);
    while (!open.empty()) {
      const OpenMesh::FaceHandle face = open.back();
      open.pop_back();
      for (auto next = mesh.cff_iter(face); next.is_valid(); ++next) {
        const auto index = static_cast<std::size_t>(next->idx());
        if (seen[index]) continue;
        seen[index] = true;
        open.push_back(*next);
      }
    }
  }
  return components;
}

void count_boundary(const HalfEdges& mesh, MeshReport& report) {
  std::vector<bool> seen(mesh.n_halfedges(), false);
  for (const OpenMesh::HalfedgeHandle start : mesh.halfedges()) {
    if (!mesh.is_boundary(start)) continue;
    ++report.boundary_edges;
    if (seen[static_cast<std::size_t>(start.idx())]) continue;
    ++report.boundary_loops;
    for (OpenMesh::HalfedgeHandle at = start; !seen[static_cast<std::size_t>(at.idx())];
         at = mesh.next_halfedge_handle(at))
      seen[static_cast<std::size_t>(at.idx())] = true;
  }
}

}  // namespace

MeshReport report_on(const SurfaceMesh& mesh) {
  HalfEdges held;
  held.reserve(mesh.vertices().size(), mesh.facets().size() * 3 / 2, mesh.facets().size());
  for (const Vec3& v : mesh.vertices()) held.add_vertex({v.x(), v.y(), v.z()});
  const QuietOpenMesh quiet;  // refused faces are counted below
  MeshReport report;
  for (const Facet& f : mesh.facets()) {
    const auto vertex = [&](std::size_t i) { return OpenMesh::VertexHandle(static_cast<int>(f.vertex[i])); };
    if (!held.add_face(vertex(0), vertex(1), vertex(2)).is_valid()) ++report.refused_faces;
  }
  report.vertices = held.n_vertices();
  report.faces = held.n_faces();
  report.flat_faces = mesh.counts().flat_facets;
  for (std::uint32_t v = 0; v < mesh.vertices().size(); ++v) report.isolated_vertices += mesh.star(v).empty();
  report.components = count_components(held);
  count_boundary(held, report);
  report.closed = report.boundary_edges == 0 && report.refused_faces == 0;
  return report;
}

std::vector<std::string> describe(const MeshReport& report, const SurfaceMeshCounts& counts) {
  std::vector<std::string> lines;
  lines.push_back(fmt::format("mesh: {} vertices, {} faces, {} component{}, {}", report.vertices,
                              report.faces + report.refused_faces, report.components,
                              report.components == 1 ? "" : "s", report.closed ? "closed" : "open"));
  if (report.boundary_edges > 0)
    lines.push_back(
        fmt::format("mesh: {} boundary edges in {} loops: the god object stops there and the probe "
                    "leaves past them",
                    report.boundary_edges, report.boundary_loops));
  if (report.refused_faces + counts.radial_edges > 0)
    lines.push_back(
        fmt::format("mesh: {} edges of three or more faces; {} faces at complex edges or corners are "
                    "not held by OpenMesh but rendered all the same",
                    counts.radial_edges, report.refused_faces));
  if (counts.welded_vertices > 0)
    lines.push_back(fmt::format("mesh: {} repeated vertices welded, {} collapsed faces dropped",
                                counts.welded_vertices, counts.collapsed_facets));
  if (report.flat_faces + report.isolated_vertices + counts.flipped_edges > 0)
    lines.push_back(
        fmt::format("mesh: {} faces without area, {} isolated vertices, {} edges between faces of "
                    "opposite orientation",
                    report.flat_faces, report.isolated_vertices, counts.flipped_edges));
  return lines;
}

}  // namespace palpate::baselines
