#include "baselines/renderers/mesh_body.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>
#include <utility>

#include <palpate/model_store.h>
#include <palpate/result.h>
#include "baselines/mesh/mesh_repair.h"
#include "baselines/mesh/surface_mesh.h"
#include "baselines/option_specs.h"
#include "baselines/renderers/mesh_source.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/statistics.h"
#include "toolkit/render/prepare.h"
#include "toolkit/search/point_search.h"

namespace palpate::baselines {
namespace {

using render::Decision;

/// Measured: mesh, facet links, tree.
constexpr double kBytesPerFacet = 196.0;
/// Of decimation, 500,000 facets (docs/results/rivals.md).
constexpr double kDecimateMsPerMillion = 40'000.0;
constexpr double kPerMillion = 1e-6;

Decision refine_decision(const MeshDecision& d) {
  if (d.smoothing == 0 && !(d.keeps < 1.0))
    return {"facets", "all, where they are", "nothing asks for fewer"};
  std::string choice = d.keeps < 1.0 ? fmt::format("{:.3g} of them", d.keeps) : "all";
  if (d.smoothing > 0) choice += fmt::format(", smoothed {} times", d.smoothing);
  return {"facets", std::move(choice), "as given", true};
}

/// Refuses options that cannot be repeated for every image.
Status check_stream(const render::ModelInput& input, const MeshDecision& d) {
  const auto refuse = [&](std::string what, std::string remedy) {
    return Error{fmt::format("model '{}' is a stream: {}", input.name, what), std::move(remedy)};
  };
  if (!d.point) return refuse("no sphere follows its meshes", "take mesh-godobject, or radius=0 for a point");
  if (d.repairs || d.smoothing > 0 || d.keeps < 1.0 || d.crossings || d.checks)
    return refuse("its meshes are felt as they are",
                  "leave out repair, smooth, decimate, crossings and check");
  if (input.surface.per_point != nullptr)
    return refuse("its points have no properties of their own", "leave out regions and columns");
  return Done{};
}

}  // namespace

Result<MeshDecision> decide_body(const render::ModelInput& input, const Options& options,
                                 const MeshProbeKind& kind) {
  PALPATE_ASSIGN(MeshSource source, decide_mesh(input, options));
  PALPATE_ASSIGN(render::SurfaceDecision surface, render::decide_surface(input));
  MeshDecision decided;
  decided.source = std::move(source);
  decided.repairs = options.flag("repair");
  decided.smoothing = options.integer("smooth");
  decided.keeps = options.number("decimate");
  decided.normals = options.text("shading") == "interpolated";
  if (options.text("frame") == "world") decided.frame = MeshFrame::kWorld;
  decided.point = kind.crossings;
  decided.checks = options.flag("check");
  decided.crossings = kind.crossings && options.flag("crossings");
  decided.surface = std::move(surface);
  if (input.camera != nullptr) PALPATE_TRY(check_stream(input, decided));
  return decided;
}

render::ModelDecisions explanation(const render::ModelInput& input, const MeshDecision& decision,
                                   const MeshProbeKind& kind) {
  render::ModelDecisions out;
  out.name = input.name;
  out.points = input.cloud->size();
  const double made = decision.source.facets, facets = made * decision.keeps;
  out.bytes = static_cast<std::uint64_t>(kBytesPerFacet * facets);
  out.prepare_ms = expected_ms(decision.source, out.points);
  if (decision.repairs || decision.smoothing > 0) out.prepare_ms.reset();
  if (out.prepare_ms)
    *out.prepare_ms += kPerMillion * (kind.ms_per_million_facets * facets +
                                      (decision.keeps < 1.0 ? kDecimateMsPerMillion * made : 0.0));
  out.frame_us = kind.frame_us;
  const auto add_decision = [&out](const char* about, bool given, const char* choice, const char* reason,
                                   const char* usual, const char* because) {
    out.decisions.push_back(given ? Decision{about, choice, reason, true} : Decision{about, usual, because});
  };
  out.decisions.push_back(decision.source.explanation);
  add_decision("repair", decision.repairs, "on",
               "oriented, cut where too many facets meet, small holes filled", "none",
               "the mesh is felt as it is");
  out.decisions.push_back(refine_decision(decision));
  out.decisions.push_back(kind.probe);
  add_decision("frame", decision.frame == MeshFrame::kWorld, "the file's",
               "as given: far from its origin single precision loses the mesh", "the mesh's own middle",
               "single precision resolves the mesh wherever it lies");
  add_decision("check", decision.checks, "pieces and borders", "as given: for people, frames do not read it",
               "none", "frames do not need it");
  add_decision("crossing facets", decision.crossings, "found",
               "as given: where sheets cross, both hold a point", "not looked for",
               kind.crossings ? "Zilles and Salisbury look for none" : "a sphere rides over folds and gaps");
  add_decision("shading", decision.normals, "interpolated vertex normals", "as given", "none",
               "a facet's own plane");
  const bool own_vertices = !decision.source.made && input.camera == nullptr;
  render::describe_surface(input, decision.surface, kMeshFeatures,
                           own_vertices ? input.original_mesh->vertices_mm.size() : out.points, out);
  if (input.motion != nullptr)
    out.decisions.push_back({"motion", "pose read in each frame", "the scene moves it", true});
  return out;
}

namespace {

/// Most edges sampled for their median, evenly spread.
constexpr std::size_t kEdgeSample = 100'000;

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

/// Vertices a chunk for parallel work; does not affect results.
constexpr std::size_t kChunk = 4096;

/// The cloud's nearest point for every vertex; in meshes through the points the vertex itself.
std::vector<std::uint32_t> points_of_vertices(const SurfaceMesh& mesh, const cloud::Cloud& cloud,
                                              int threads) {
  const search::PointSearch points(cloud);
  std::vector<std::uint32_t> nearest(mesh.vertices().size());
  parallel_each(nearest.size(), kChunk, threads, [&](std::size_t v) {
    nearest[v] = static_cast<std::uint32_t>(points.nearest(mesh.vertices()[v] + mesh.origin_mm()));
  });
  return nearest;
}

/// Limits how fast stiffness rises along the mesh, as along points (see blend_stiffness).
std::size_t blend(MeshBody& body) {
  const SurfaceMesh& mesh = body.mesh();
  std::vector<surface::OrientedPoint> points(mesh.vertices().size());
  std::vector<search::Neighbours> around(points.size());
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
  PALPATE_ASSIGN(body.surface, render::build_surface_field(input, order, report));
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
  specs.push_back(option::choice("shading", "none", "force shading by interpolated vertex normals, or none",
                                 {"none", "interpolated"}));
  specs.push_back(option::choice("frame", "local",
                                 "coordinates begin in the mesh's middle, or where the file says (Embree "
                                 "reads them in single precision)",
                                 {"local", "world"}));
  specs.push_back(option::flag("check", "false",
                               "count the mesh's pieces and border loops (OpenMesh), and warn of shards"));
  specs.push_back(
      option::flag("crossings", "false",
                   "look for facets that cross others, which then hold the god object, and warn of folds"));
  specs.push_back(option::choice(
      "combine", "joint", "several models touched at once: constrained jointly, or the sum of their forces",
      {"joint", "sum"}));
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
  PALPATE_ASSIGN(auto source, mesh_of(input, decided.source, options, context.threads, phases));
  PALPATE_ASSIGN(source, refined(std::move(source), input, options, context.threads, phases));
  phases.begin("connect facets");
  PALPATE_ASSIGN(made->mesh, SurfaceMesh::build(*source, context.threads, MeshOrder::kCurve, decided.frame));
  // The scene keeps its own faces anyway; others are freed here.
  if (source == input.original_mesh) made->given = input.original_mesh;
  source.reset();
  made->median_edge_mm = median_edge(made->mesh);
  if (decided.normals) made->vertex_normals = interpolation_normals(made->mesh);
  phases.end();
  if (decided.point) {
    phases.begin("sides of pieces");
    made->sides = PieceOrientation::of(made->mesh, context.threads);
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
  PALPATE_ASSIGN(auto index, SegmentIndex::build(made->mesh, context.threads));
  made->index = std::make_unique<SegmentIndex>(std::move(index));
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
  // Only for a point: a sphere passes over folds and gaps.
  if (decided.point)
    for (std::string& line :
         mesh_warnings(made->mesh, seen, made->crossings.folded(), options.flag("repair")))
      phases.warn(std::move(line));
  report.bytes += made->bytes();
  return std::shared_ptr<const MeshGeometry>(std::move(made));
}

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
  if (input.camera != nullptr) {  // the first image brings the mesh
    const Vec3 origin_mm = decided.frame == MeshFrame::kWorld ? Vec3(Vec3::Zero()) : input.cloud->origin_mm;
    body->pose = render::ModelPose(input, origin_mm);
    PALPATE_ASSIGN(body->surface, render::build_uniform_surface_field(input.surface, report));
    return body;
  }
  PALPATE_ASSIGN(body->geometry, render::get_or_build<MeshGeometry>(
                                     context, report, [&] { return key_of(input, decided, options); },
                                     [&](render::PrepareReport& to) {
                                       return build_geometry(input, decided, options, context, to);
                                     }));
  body->pose = render::ModelPose(input, body->mesh().origin_mm());
  render::PreparePhases phases(report, context);
  if (input.surface.per_point != nullptr) phases.begin("surface of the vertices");
  PALPATE_TRY(prepare_surface(input, *body, context, report));
  if (input.surface.per_point != nullptr) phases.end();
  report.bytes += body->surface.bytes();
  return body;
}

}  // namespace palpate::baselines
