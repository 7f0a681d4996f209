#include "baselines/renderers/mesh_body.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "baselines/mesh/mesh_report.h"
#include "baselines/renderers/mesh_source.h"
#include "baselines/renderers/vertex_normals.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {
namespace {

/// Edges looked at for their median, at most, evenly spread.
constexpr std::size_t kEdgeSample = 100'000;

double median_edge(const SurfaceMesh& mesh) {
  const std::size_t facets = mesh.facets().size();
  const std::size_t stride = facets / kEdgeSample + 1;
  std::vector<double> lengths;
  lengths.reserve(3 * (facets / stride + 1));
  for (std::size_t i = 0; i < facets; i += stride) {
    const Facet& f = mesh.facets()[i];
    for (std::uint32_t e = 0; e < 3; ++e) lengths.push_back((f.corner[after(e)] - f.corner[e]).norm());
  }
  const auto middle = lengths.begin() + static_cast<std::ptrdiff_t>(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  return *middle;
}

}  // namespace

std::size_t MeshBody::bytes() const noexcept {
  return source->bytes() + mesh.bytes() + index->bytes() + crossings.bytes() +
         vertex_normals.capacity() * sizeof(Vec3f) + surface.bytes();
}

std::vector<OptionSpec> mesh_renderer_specs() {
  std::vector<OptionSpec> specs = mesh_source_specs();
  OptionSpec shading{"shading", OptionKind::kChoice, "none",
                     "force shading by interpolated vertex normals, or none"};
  shading.choices = {"none", "interpolated"};
  specs.push_back(std::move(shading));
  return specs;
}

bool wants_shading(const Options& options) {
  return options.text("shading") == "interpolated";
}

Result<std::unique_ptr<MeshBody>> prepare_body(const render::ModelInput& input, const Options& options,
                                               const MeshBodyNeeds& needs,
                                               const render::PrepareContext& context,
                                               render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  auto body = std::make_unique<MeshBody>();
  auto source = mesh_of(input, options, phases);
  if (!source.ok()) return std::move(source).error();
  body->source = std::move(source).value();
  phases.begin("connect facets");
  auto mesh = SurfaceMesh::build(*body->source, context.threads);
  if (!mesh.ok()) return std::move(mesh).error();
  body->mesh = std::move(mesh).value();
  body->median_edge_mm = median_edge(body->mesh);
  if (needs.normals) body->vertex_normals = interpolation_normals(body->mesh);
  phases.end();
  phases.begin("check (OpenMesh)");
  for (std::string& line : describe(report_on(body->mesh), body->mesh.counts()))
    report.notes.push_back(std::move(line));
  phases.end();
  phases.begin("build tree (Embree)");
  auto index = SegmentIndex::build(body->mesh, context.threads);
  if (!index.ok()) return std::move(index).error();
  body->index = std::make_unique<SegmentIndex>(std::move(index).value());
  phases.end();
  if (needs.crossings) {
    phases.begin("find crossing facets");
    body->crossings = Crossings::find(body->mesh, *body->index, context.threads);
    phases.end();
    if (body->crossings.any())
      report.notes.push_back(
          fmt::format("mesh: {} facets cross others ({} pairs): they constrain the god object",
                      body->crossings.facets(), body->crossings.pairs()));
  }
  body->pose = render::ModelPose(input, body->mesh.origin_mm());
  if (input.surface.per_point != nullptr)
    return Error{fmt::format("model '{}' has properties that differ from point to point", input.name),
                 "mesh renderers take one value for the whole model: leave out regions and columns",
                 {},
                 0};
  Result<render::SurfaceField> surface = render::build_uniform_surface_field(input.surface, report);
  if (!surface.ok()) return std::move(surface).error();
  body->surface = std::move(surface).value();
  report.bytes += body->bytes();
  return body;
}

}  // namespace palpate::baselines
