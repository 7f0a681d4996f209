#include "baselines/mesh/mesh_repair.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <palpate/result.h>
#include "baselines/mesh/pieces.h"
#include "baselines/mesh/surface_mesh.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wsign-conversion"
#pragma GCC diagnostic ignored "-Wold-style-cast"
#pragma GCC diagnostic ignored "-Wcast-qual"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wpedantic"
#pragma GCC diagnostic ignored "-Wdouble-promotion"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Tools/Decimater/DecimaterT.hh>
#include <OpenMesh/Tools/Decimater/ModAspectRatioT.hh>
#include <OpenMesh/Tools/Decimater/ModNormalFlippingT.hh>
#include <OpenMesh/Tools/Decimater/ModQuadricT.hh>
#include <OpenMesh/Tools/Smoother/JacobiLaplaceSmootherT.hh>
#pragma GCC diagnostic pop

namespace palpate::baselines {
namespace {

// OpenMesh's half-edges in double precision.
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

std::vector<std::string> mesh_warnings(const SurfaceMesh& mesh, const MeshReport* report, std::size_t folded,
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

namespace {

/// Largest turn of a facet's normal per collapse: with the library's 90 degrees slivers flip in two steps.
constexpr float kMaxTurnDegrees = 45.0f;
/// Largest slenderness (longest edge over height) after a collapse; the library's default. The quadric error,
/// zero on straight lines, would allow facets without area.
constexpr float kMaxSlender = 10.0f;

using Corners = std::array<std::uint32_t, 3>;

std::size_t turn_to_agree(const SurfaceMesh& mesh, std::vector<Corners>& facets) {
  const Pieces pieces = pieces_across_many(mesh);
  std::size_t flipped = 0;
  for (std::size_t i = 0; i < facets.size(); ++i) {
    if (pieces.side(static_cast<std::uint32_t>(i)) == 0) continue;
    std::swap(facets[i][1], facets[i][2]);
    ++flipped;
  }
  return flipped;
}

/// Adds facets; those that half-edges cannot represent get corners of their own. Returns how many.
std::size_t fill(const std::vector<Vec3>& vertices, const std::vector<Corners>& facets, HalfEdges& held) {
  held.reserve(vertices.size(), facets.size() * 3 / 2, facets.size());
  const auto add_vertex = [&](const Vec3& v) { return held.add_vertex({v.x(), v.y(), v.z()}); };
  for (const Vec3& v : vertices) add_vertex(v);
  const QuietOpenMesh quiet;
  std::size_t cut = 0;
  const auto handle = [](std::uint32_t v) { return OpenMesh::VertexHandle(static_cast<int>(v)); };
  for (const Corners& f : facets) {
    if (held.add_face(handle(f[0]), handle(f[1]), handle(f[2])).is_valid()) continue;
    ++cut;
    held.add_face(add_vertex(vertices[f[0]]), add_vertex(vertices[f[1]]), add_vertex(vertices[f[2]]));
  }
  return cut;
}

geometry::TriangleMesh plain(const HalfEdges& held, const Vec3& origin) {
  geometry::TriangleMesh mesh;
  std::vector<std::uint32_t> number(held.n_vertices(), 0);
  for (const OpenMesh::VertexHandle v : held.vertices()) {
    if (held.is_isolated(v)) continue;
    number[static_cast<std::size_t>(v.idx())] = static_cast<std::uint32_t>(mesh.vertices_mm.size());
    const auto& p = held.point(v);
    mesh.vertices_mm.push_back(origin + Vec3(p[0], p[1], p[2]));
  }
  for (const OpenMesh::FaceHandle f : held.faces()) {
    Corners corners{};
    std::size_t i = 0;
    for (const OpenMesh::VertexHandle v : held.fv_range(f))
      if (i < 3) corners[i++] = number[static_cast<std::size_t>(v.idx())];
    mesh.triangles.push_back(corners);
  }
  return mesh;
}

/// A welded mesh as plain arrays relative to its origin, which keeps precision far from zero.
struct Welded {
  SurfaceMesh mesh;
  std::vector<Vec3> vertices;
  std::vector<Corners> facets;
};

Result<Welded> weld(const geometry::TriangleMesh& mesh) {
  PALPATE_ASSIGN(SurfaceMesh built, SurfaceMesh::build(mesh, 1));
  Welded welded;
  welded.mesh = std::move(built);
  welded.vertices.assign(welded.mesh.vertices().begin(), welded.mesh.vertices().end());
  for (const Facet& f : welded.mesh.facets()) welded.facets.push_back(f.vertex);
  return welded;
}

/// Boundary half-edges around a hole, in order; empty if longer than `most` or touching itself.
std::vector<OpenMesh::VertexHandle> loop_from(const HalfEdges& held, OpenMesh::HalfedgeHandle start,
                                              std::size_t most, std::vector<bool>& seen) {
  std::vector<OpenMesh::VertexHandle> loop;
  OpenMesh::HalfedgeHandle at = start;
  std::size_t length = 0;
  do {
    seen[static_cast<std::size_t>(at.idx())] = true;
    if (++length <= most) loop.push_back(held.from_vertex_handle(at));
    at = held.next_halfedge_handle(at);
  } while (at != start);
  std::vector<int> places;
  for (const OpenMesh::VertexHandle v : loop) places.push_back(v.idx());
  std::sort(places.begin(), places.end());
  const bool simple = std::adjacent_find(places.begin(), places.end()) == places.end();
  if (length > most || length < 3 || !simple) loop.clear();
  return loop;
}

/// Least-area triangulation of a loop, as triples of loop positions; empty if every one would duplicate an
/// edge.
std::vector<std::array<std::size_t, 3>> least_area(const HalfEdges& held,
                                                   const std::vector<OpenMesh::VertexHandle>& loop) {
  const std::size_t n = loop.size();
  const auto area = [&](std::size_t i, std::size_t j, std::size_t k) {
    const auto a = held.point(loop[i]);
    return ((held.point(loop[j]) - a) % (held.point(loop[k]) - a)).norm();
  };
  const auto is_new = [&](std::size_t i, std::size_t j) {
    return j == i + 1 || (i == 0 && j == n - 1) || !held.find_halfedge(loop[i], loop[j]).is_valid();
  };
  std::vector<double> cost(n * n, 0.0);
  std::vector<std::size_t> apex(n * n, 0);
  for (std::size_t span = 2; span < n; ++span)
    for (std::size_t i = 0; i + span < n; ++i) {
      const std::size_t k = i + span;
      double best = HUGE_VAL;
      if (is_new(i, k))
        for (std::size_t j = i + 1; j < k; ++j) {
          const double sum = cost[i * n + j] + cost[j * n + k] + area(i, j, k);
          if (!(sum < best)) continue;
          best = sum;
          apex[i * n + k] = j;
        }
      cost[i * n + k] = best;
    }
  std::vector<std::array<std::size_t, 3>> facets;
  if (!(cost[n - 1] < HUGE_VAL)) return facets;
  std::vector<std::array<std::size_t, 2>> open{{0, n - 1}};
  while (!open.empty()) {
    const auto [i, k] = open.back();
    open.pop_back();
    if (k < i + 2) continue;
    const std::size_t j = apex[i * n + k];
    facets.push_back({i, j, k});
    open.push_back({i, j});
    open.push_back({j, k});
  }
  return facets;
}

void fill_holes(HalfEdges& held, std::size_t max_edges, RepairReport& report) {
  std::vector<bool> seen(held.n_halfedges(), false);
  std::vector<std::vector<OpenMesh::VertexHandle>> loops;
  for (const OpenMesh::HalfedgeHandle start : held.halfedges()) {
    if (!held.is_boundary(start) || seen[static_cast<std::size_t>(start.idx())]) continue;
    loops.push_back(loop_from(held, start, max_edges, seen));
  }
  const QuietOpenMesh quiet;
  for (const auto& loop : loops) {
    std::size_t added = 0;
    if (!loop.empty())
      for (const auto& f : least_area(held, loop))
        added += held.add_face(loop[f[0]], loop[f[1]], loop[f[2]]).is_valid();
    report.filled_holes += added > 0;
    report.left_loops += added == 0;
    report.filled_facets += added;
  }
}

}  // namespace

Result<geometry::TriangleMesh> repaired(const geometry::TriangleMesh& mesh, std::size_t max_hole_edges,
                                        RepairReport* report) {
  RepairReport unused;
  RepairReport& r = report != nullptr ? *report : unused;
  r = {};
  PALPATE_ASSIGN(Welded welded, weld(mesh));
  r.welded = welded.mesh.counts().welded_vertices;
  r.dropped = welded.mesh.counts().collapsed_facets;
  r.flipped = turn_to_agree(welded.mesh, welded.facets);
  HalfEdges held;
  r.cut = fill(welded.vertices, welded.facets, held);
  fill_holes(held, max_hole_edges, r);
  return plain(held, welded.mesh.origin_mm());
}

Result<geometry::TriangleMesh> decimated(const geometry::TriangleMesh& mesh, double share) {
  if (!(share > 0.0 && share <= 1.0))
    return Error{"a mesh is decimated to a share of its facets above 0 and at most 1", "set decimate"};
  PALPATE_ASSIGN(const Welded welded, weld(mesh));
  HalfEdges held;
  fill(welded.vertices, welded.facets, held);
  held.request_face_normals();
  held.update_face_normals();
  OpenMesh::Decimater::DecimaterT<HalfEdges> decimater(held);
  OpenMesh::Decimater::ModQuadricT<HalfEdges>::Handle quadric;
  OpenMesh::Decimater::ModNormalFlippingT<HalfEdges>::Handle flipping;
  decimater.add(quadric);
  decimater.add(flipping);
  OpenMesh::Decimater::ModAspectRatioT<HalfEdges>::Handle ratio;
  decimater.add(ratio);
  decimater.module(quadric).unset_max_err();
  decimater.module(flipping).set_max_normal_deviation(kMaxTurnDegrees);
  decimater.module(ratio).set_aspect_ratio(kMaxSlender);
  if (!decimater.initialize()) return Error{"OpenMesh's decimater did not start", "report this"};
  const auto target = static_cast<std::size_t>(share * static_cast<double>(held.n_faces()));
  decimater.decimate_to_faces(0, target);
  held.garbage_collection();
  return plain(held, welded.mesh.origin_mm());
}

Result<geometry::TriangleMesh> smoothed(const geometry::TriangleMesh& mesh, int iterations) {
  PALPATE_ASSIGN(const Welded welded, weld(mesh));
  HalfEdges held;
  fill(welded.vertices, welded.facets, held);
  using Smoother = OpenMesh::Smoother::JacobiLaplaceSmootherT<HalfEdges>;
  Smoother smoother(held);
  smoother.initialize(Smoother::Tangential_and_Normal, Smoother::C1);
  smoother.smooth(static_cast<unsigned int>(std::max(iterations, 0)));
  return plain(held, welded.mesh.origin_mm());
}

}  // namespace palpate::baselines
