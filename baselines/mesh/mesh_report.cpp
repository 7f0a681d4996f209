#include "baselines/mesh/mesh_report.h"

#include <fmt/format.h>

#include "baselines/mesh/half_edges.h"
#include "baselines/mesh/pieces.h"

namespace palpate::baselines {
namespace {

/// Counts components over edges of any number of faces, and faces in shards.
void count_components(const SurfaceMesh& mesh, MeshReport& report) {
  struct Component {
    std::size_t faces = 0;
    bool open = false;
  };
  const std::vector<std::uint32_t> number = components_of(mesh);
  std::vector<Component> components;
  for (std::uint32_t i = 0; i < number.size(); ++i) {
    if (number[i] >= components.size()) components.resize(number[i] + 1);
    Component& own = components[number[i]];
    ++own.faces;
    for (std::uint32_t e = 0; e < 3; ++e)
      own.open = own.open || mesh.neighbour(half_facet(i, 0), e) == kNoFacet;
  }
  report.components = components.size();
  std::size_t shards = 0, faces = 0;
  for (const Component& component : components) {
    if (!component.open || component.faces >= kFewFaces) continue;
    ++shards;
    faces += component.faces;
  }
  if (shards >= kManyShards) report.shattered_faces = faces;
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
  count_components(mesh, report);
  count_boundary(held, report);
  report.closed = report.boundary_edges == 0 && report.refused_faces == 0;
  return report;
}

namespace {

std::string first_line(const SurfaceMesh& mesh, const MeshReport* report) {
  const SurfaceMeshCounts& counts = mesh.counts();
  if (report == nullptr)
    return fmt::format(
        "mesh: {} vertices, {} faces, {}; its pieces and borders were not looked at (check=true does)",
        counts.vertices, mesh.facets().size(), counts.boundary_edges == 0 ? "without a border" : "open");
  return fmt::format("mesh: {} vertices, {} faces, {} component{}, {}", report->vertices,
                     report->faces + report->refused_faces, report->components,
                     report->components == 1 ? "" : "s", report->closed ? "closed" : "open");
}

std::string border_line(const SurfaceMeshCounts& counts, const MeshReport* report) {
  const std::string loops = report == nullptr ? "" : fmt::format(" in {} loops", report->boundary_loops);
  return fmt::format("mesh: {} boundary edges{}: the god object stops there and the probe leaves past them",
                     report == nullptr ? counts.boundary_edges : report->boundary_edges, loops);
}

}  // namespace

std::vector<std::string> describe(const SurfaceMesh& mesh, const MeshReport* report) {
  const SurfaceMeshCounts& counts = mesh.counts();
  std::vector<std::string> lines{first_line(mesh, report)};
  if ((report == nullptr ? counts.boundary_edges : report->boundary_edges) > 0)
    lines.push_back(border_line(counts, report));
  if (counts.radial_edges > 0)
    lines.push_back(fmt::format("mesh: {} edges of three or more faces", counts.radial_edges));
  if (report != nullptr && report->refused_faces > 0)
    lines.push_back(fmt::format(
        "mesh: {} faces at complex edges or corners are not held by OpenMesh but rendered all the same",
        report->refused_faces));
  if (counts.repeated_facets > 0)
    lines.push_back(
        fmt::format("mesh: {} faces that lie on others left out, and {} fins: a face and its back that stick "
                    "out of a surface",
                    counts.repeated_facets, counts.fins));
  if (counts.welded_vertices > 0)
    lines.push_back(fmt::format("mesh: {} repeated vertices welded, {} collapsed faces dropped",
                                counts.welded_vertices, counts.collapsed_facets));
  if (counts.flat_facets + counts.flipped_edges > 0)
    lines.push_back(fmt::format("mesh: {} faces without area, {} edges between faces of opposite orientation",
                                counts.flat_facets, counts.flipped_edges));
  if (report != nullptr && report->isolated_vertices > 0)
    lines.push_back(fmt::format("mesh: {} isolated vertices", report->isolated_vertices));
  return lines;
}

namespace {

/// Measured over nine methods on six generated models (docs/how-to/prepare-a-scan.md): with one crossing
/// facet in a thousand, forces had only the mesh's own error; with more, folds caught god objects, with
/// forces up to twenty times the true ones.
constexpr double kFoldedShare = 1e-3;
/// Largest share of edges with more than two facets, and of faces in shards, that is a flaw and not another
/// kind of mesh.
constexpr double kRadialShare = 0.01, kShatteredShare = 0.01;

double share_of(std::size_t part, std::size_t whole) {
  return whole > 0 ? static_cast<double>(part) / static_cast<double>(whole) : 0.0;
}

std::string percent(double share) {
  constexpr double kPercent = 100.0;
  return fmt::format("{:.2g} %", kPercent * share);
}

}  // namespace

std::vector<std::string> doubts(const SurfaceMesh& mesh, const MeshReport* report, std::size_t folded,
                                bool repaired) {
  std::vector<std::string> lines;
  const SurfaceMeshCounts& counts = mesh.counts();
  const std::size_t faces = mesh.facets().size();
  if (const double share = share_of(counts.radial_edges, counts.edges); share > kRadialShare)
    lines.push_back(fmt::format(
        "{} of the mesh's edges have more than two faces: it is not one sheet, and a god object may get "
        "between its layers; {}take another reconstruction, for example mesh=advancing-front",
        percent(share), repaired ? "" : "repair=true makes sheets of it, or "));
  if (counts.largest_fan > kMaxFan)
    lines.push_back(fmt::format(
        "{} of the mesh's faces meet at one vertex, and a frame looks at {} of them: near it the god object "
        "may be let in, or held where it should slide on; cut the corner off, or reconstruct the mesh from "
        "points that lie as dense around it as along, for example mesh=advancing-front",
        counts.largest_fan, kMaxFan));
  if (const double share = share_of(report == nullptr ? 0 : report->shattered_faces, faces);
      share > kShatteredShare)
    lines.push_back(fmt::format(
        "the mesh is in {} pieces, {} of its faces in open ones of fewer than {}: a god object falls off "
        "each; weld its vertices, or reconstruct it from the points, for example mesh=advancing-front",
        report->components, percent(share), kFewFaces));
  if (const double share = share_of(folded, faces); share > kFoldedShare)
    lines.push_back(
        fmt::format("{} of the mesh's faces cross others of the same piece ({}): a god object may be caught "
                    "in such folds, and its forces are not to be trusted; take another reconstruction, for "
                    "example mesh=poisson, or a body that rides over them, mesh-proxy",
                    folded, percent(share)));
  return lines;
}

}  // namespace palpate::baselines
