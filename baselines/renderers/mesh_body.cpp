#include "baselines/renderers/mesh_body.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>

#include "baselines/mesh/mesh_report.h"
#include "baselines/renderers/mesh_refine.h"
#include "baselines/renderers/mesh_source.h"
#include "baselines/renderers/vertex_normals.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/nearest_rank.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/try.h"
#include "toolkit/partition/point_search.h"
#include "toolkit/render/model_store.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
namespace {

/// Edges looked at for their median, at most, evenly spread.
constexpr std::size_t kEdgeSample = 100'000;

/// The options that say which mesh it is.
std::vector<OptionSpec> mesh_specs() {
  std::vector<OptionSpec> specs = mesh_source_specs();
  for (OptionSpec& spec : mesh_refine_specs()) specs.push_back(std::move(spec));
  return specs;
}

double median_edge(const SurfaceMesh& mesh) {
  const std::size_t facets = mesh.facets().size();
  const std::size_t stride = facets / kEdgeSample + 1;
  std::vector<double> lengths;
  lengths.reserve(3 * (facets / stride + 1));
  for (std::size_t i = 0; i < facets; i += stride) {
    const Facet& f = mesh.facets()[i];
    for (std::uint32_t e = 0; e < 3; ++e) lengths.push_back((f.corner[after(e)] - f.corner[e]).norm());
  }
  return upper_median(std::move(lengths));
}

/// Vertices a chunk, for parallel work; decides nothing about the result.
constexpr std::size_t kChunk = 4096;

/// For every vertex the cloud's nearest point: the vertex's own where the mesh goes through the points.
std::vector<std::uint32_t> points_of_vertices(const SurfaceMesh& mesh, const cloud::Cloud& cloud,
                                              int threads) {
  const partition::PointSearch points(cloud);
  std::vector<std::uint32_t> nearest(mesh.vertices().size());
  parallel_chunks(nearest.size(), kChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t v = begin; v < end; ++v)
      nearest[v] = static_cast<std::uint32_t>(points.nearest(mesh.vertices()[v] + mesh.origin_mm()));
  });
  return nearest;
}

/// The stiffness rises no faster along the mesh than along points (see blend_stiffness).
std::size_t blend(MeshBody& body) {
  const SurfaceMesh& mesh = body.mesh();
  std::vector<surface::SurfacePoint> points(mesh.vertices().size());
  std::vector<neighbourhood::Neighbours> around(points.size());
  for (std::uint32_t v = 0; v < points.size(); ++v) {
    const Vec3f p = mesh.vertices()[v].cast<float>();
    points[v] = {p.x(), p.y(), p.z(), surface::kNoNormal};
    around[v].fill(v);
    std::size_t count = 0;
    for (const std::uint32_t facet : mesh.star(v))
      for (const std::uint32_t other : mesh.facet(facet).vertex) {
        const auto last = around[v].begin() + static_cast<std::ptrdiff_t>(count);
        if (other == v || count == around[v].size() || std::find(around[v].begin(), last, other) != last)
          continue;
        around[v][count++] = other;
      }
  }
  return render::blend_stiffness(body.surface, points, around,
                                 render::kBlendResolutions * body.geometry->median_edge_mm);
}

Status prepare_surface(const render::ModelInput& input, MeshBody& body, const render::PrepareContext& context,
                       render::PrepareReport& report) {
  std::vector<std::uint32_t> order;
  if (input.surface.per_point != nullptr)
    order = points_of_vertices(body.mesh(), *input.cloud, context.threads);
  Result<render::SurfaceField> surface = render::build_surface_field(input, order, report);
  if (!surface.ok()) return std::move(surface).error();
  body.surface = std::move(surface).value();
  if ((body.surface.features & render::kVaried) == 0) return Done{};
  const std::size_t softer = blend(body);
  report.notes.push_back(
      fmt::format("properties: each vertex has those of the nearest point; stiffness blended over {:.3g} mm, "
                  "{} made softer",
                  render::kBlendResolutions * body.geometry->median_edge_mm, softer));
  return Done{};
}

}  // namespace

std::size_t MeshGeometry::bytes() const noexcept {
  return mesh.bytes() + index->bytes() + crossings.bytes() + sides.bytes() +
         vertex_normals.capacity() * sizeof(Vec3f);
}

std::vector<OptionSpec> mesh_renderer_specs() {
  std::vector<OptionSpec> specs = mesh_specs();
  OptionSpec shading{"shading", OptionKind::kChoice, "none",
                     "force shading by interpolated vertex normals, or none"};
  shading.choices = {"none", "interpolated"};
  specs.push_back(std::move(shading));
  specs.push_back(
      {"frame",
       OptionKind::kChoice,
       "local",
       "coordinates begin in the mesh's middle, or where the file says (Embree reads them in single "
       "precision)",
       {"local", "world"}});
  specs.push_back({"check",
                   OptionKind::kFlag,
                   "false",
                   "count the mesh's pieces and border loops (OpenMesh), and warn of shards",
                   {}});
  specs.push_back({"crossings",
                   OptionKind::kFlag,
                   "false",
                   "look for facets that cross others, which then hold the god object, and warn of folds",
                   {}});
  specs.push_back({"combine",
                   OptionKind::kChoice,
                   "joint",
                   "several models touched at once: constrained jointly, or the sum of their forces",
                   {"joint", "sum"}});
  return specs;
}

namespace {

Result<std::shared_ptr<const MeshGeometry>> build_geometry(const render::ModelInput& input,
                                                           const MeshDecision& decided,
                                                           const Options& options,
                                                           const render::PrepareContext& context,
                                                           render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  auto made = std::make_shared<MeshGeometry>();
  auto source = mesh_of(input, decided.source, options, context.threads, phases);
  if (!source.ok()) return std::move(source).error();
  source = refined(std::move(source).value(), input, options, context.threads, phases);
  if (!source.ok()) return std::move(source).error();
  phases.begin("connect facets");
  auto mesh = SurfaceMesh::build(**source, context.threads, MeshOrder::kCurve, decided.frame);
  if (!mesh.ok()) return std::move(mesh).error();
  made->mesh = std::move(mesh).value();
  // The scene holds its own faces anyway; any others are given back here.
  if (*source == input.original_mesh) made->given = input.original_mesh;
  source->reset();
  made->median_edge_mm = median_edge(made->mesh);
  if (decided.normals) made->vertex_normals = interpolation_normals(made->mesh);
  phases.end();
  if (decided.point) {
    phases.begin("sides of pieces");
    made->sides = PieceSides::of(made->mesh, context.threads);
    phases.end();
  }
  std::optional<MeshReport> found;
  if (decided.checks) {
    phases.begin("check (OpenMesh)");
    found = report_on(made->mesh);
    phases.end();
  }
  const MeshReport* const seen = found ? &*found : nullptr;
  for (std::string& line : describe(made->mesh, seen)) report.notes.push_back(std::move(line));
  phases.begin("build tree (Embree)");
  auto index = SegmentIndex::build(made->mesh, context.threads);
  if (!index.ok()) return std::move(index).error();
  made->index = std::make_unique<SegmentIndex>(std::move(index).value());
  phases.end();
  if (decided.crossings) {
    phases.begin("find crossing facets");
    made->crossings = Crossings::find(made->mesh, *made->index, context.threads);
    phases.end();
    if (made->crossings.any())
      report.notes.push_back(
          fmt::format("mesh: {} facets cross others ({} pairs): they constrain the god object",
                      made->crossings.facets(), made->crossings.pairs()));
  }
  // Of a point: a sphere rides over folds and gaps.
  if (decided.point)
    for (std::string& line : doubts(made->mesh, seen, made->crossings.folded(), options.flag("repair")))
      phases.warn(std::move(line));
  report.bytes += made->bytes();
  return std::shared_ptr<const MeshGeometry>(std::move(made));
}

/// All that the mesh of a model depends on.
std::string key_of(const render::ModelInput& input, const MeshDecision& decided, const Options& options) {
  ContentHash faces;
  if (input.original_mesh != nullptr) {
    for (const Vec3& vertex : input.original_mesh->vertices_mm)
      for (int axis = 0; axis < 3; ++axis) faces.u64(std::bit_cast<std::uint64_t>(vertex[axis]));
    faces.values(input.original_mesh->triangles);
  }
  return fmt::format("mesh {:016x} {} {:016x} '{}' {} {} {} {} {} {}", cloud::content_hash(*input.cloud),
                     input.cloud->size(), faces.value(),
                     input.analytic != nullptr ? input.analytic->formula() : "", decided.point,
                     decided.checks, decided.crossings, decided.normals, decided.frame == MeshFrame::kWorld,
                     render::key_text(options, mesh_specs()));
}

}  // namespace

Result<std::unique_ptr<MeshBody>> prepare_body(const render::ModelInput& input, const MeshDecision& decided,
                                               const Options& options, const render::PrepareContext& context,
                                               render::PrepareReport& report) {
  auto body = std::make_unique<MeshBody>();
  Result<std::shared_ptr<const MeshGeometry>> geometry = render::held_or_made<MeshGeometry>(
      context, report, [&] { return key_of(input, decided, options); },
      [&](render::PrepareReport& to) { return build_geometry(input, decided, options, context, to); });
  if (!geometry.ok()) return std::move(geometry).error();
  body->geometry = std::move(geometry).value();
  body->pose = render::ModelPose(input, body->mesh().origin_mm());
  render::PreparePhases phases(report, context);
  if (input.surface.per_point != nullptr) phases.begin("surface of the vertices");
  PALPATE_TRY(prepare_surface(input, *body, context, report));
  if (input.surface.per_point != nullptr) phases.end();
  report.bytes += body->surface.bytes();
  return body;
}

}  // namespace palpate::baselines
