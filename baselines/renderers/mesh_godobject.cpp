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

// Measured, what to expect: table 7 of reproduce; with the mesh there already, docs/meshes.md.
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

render::RendererInfo mesh_godobject_info() {
  render::RendererInfo info;
  info.name = kName;
  info.summary = kSummary;
  info.source = kSource;
  info.role = render::Role::kRival;
  info.geometry = render::Geometry::kMesh;
  info.supports = kMeshFeels;
  info.options = mesh_renderer_specs();
  info.make = [](const Options& options) { return make_point_on_mesh(kName, kSummary, kSource, options); };
  return info;
}

}  // namespace palpate::baselines
