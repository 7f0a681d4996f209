#include "baselines/renderers/mesh_godobject.h"

#include <fmt/format.h>

#include "baselines/renderers/mesh_probe.h"
#include "baselines/renderers/mesh_scene.h"

namespace palpate::baselines {
namespace {

constexpr const char* kName = "mesh-godobject";
constexpr const char* kSummary =
    "god object on a triangle mesh, up to three constraints solved within a frame";
constexpr const char* kSource = "Zilles and Salisbury 1995 (the thesis's [70]), entries by Embree";

// Measured expectations: table 7 of reproduce; for an existing mesh, docs/results/rivals.md.
constexpr double kFrameUs = 0.27, kMsPerMillionFacets = 400.0;

}  // namespace

std::unique_ptr<render::HapticRenderer> make_point_on_mesh(std::string name, std::string summary,
                                                           std::string source, const Options& options) {
  std::string bound = fmt::format(
      "a model: at most {} flights of two Embree queries (each O(log facets)), {} facets and one fan of {} "
      "looked at a flight; on facets that cross others times their number",
      kMaxFlights, kMaxFacetsPerFrame, kMaxFan);
  return std::make_unique<MeshScene<MeshProbe>>(
      render::Description{std::move(name), std::move(summary), std::move(source), std::move(bound), options},
      MeshProbeKind{true, {"probe", "point", "the HIP has no size"}, kFrameUs, kMsPerMillionFacets}, nullptr,
      [](const MeshBody& body) {
        return MeshProbe(body.mesh(), *body.geometry->index, body.geometry->crossings, body.geometry->sides);
      });
}

render::RendererInfo mesh_renderer_info(std::string name, std::string summary, std::string source) {
  render::RendererInfo info;
  info.name = std::move(name);
  info.summary = std::move(summary);
  info.source = std::move(source);
  info.role = render::Role::kRival;
  info.geometry = render::Geometry::kMesh;
  info.supports = kMeshFeatures;
  info.options = mesh_renderer_specs();
  return info;
}

render::RendererInfo mesh_godobject_info() {
  render::RendererInfo info = mesh_renderer_info(kName, kSummary, kSource);
  info.make = [](const Options& options) { return make_point_on_mesh(kName, kSummary, kSource, options); };
  return info;
}

}  // namespace palpate::baselines
