// The renderers `mesh-godobject` and `mesh-proxy`.
#include <palpate/result.h>
#include "baselines/rivals.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>

#include "baselines/option_specs.h"
#include "baselines/renderers/mesh_probe.h"
#include "baselines/renderers/mesh_scene.h"
#include "baselines/renderers/sphere_probe.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::baselines {
namespace {

constexpr const char* kName = "mesh-godobject";
constexpr const char* kSummary = "a god object on a triangle mesh";
constexpr const char* kSource = "Zilles and Salisbury 1995 (the thesis's [70]), entries by Embree";

// Measured expectations: table 7 of reproduce; for an existing mesh, docs/results/rivals.md.
constexpr double kFrameUs = 0.27, kMsPerMillionFacets = 400.0;

/// The god object, under a name of the caller's, which may be that of a sphere of size zero. `options`:
/// mesh_renderer_specs(); others are kept for describe().
std::unique_ptr<render::HapticRenderer> make_point_on_mesh(std::string name, std::string summary,
                                                           std::string source, const Options& options) {
  std::string bound = fmt::format(
      "a model: at most {} flights of two Embree queries (each O(log facets)), {} facets and one fan of {} "
      "looked at a flight; on facets that cross others times their number; two queries more with a new image",
      kMaxFlights, kMaxFacetsPerFrame, kMaxFan);
  return std::make_unique<MeshScene<MeshProbe>>(
      render::Description{std::move(name), std::move(summary), std::move(source), std::move(bound), options},
      MeshProbeKind{true, {"probe", "point", "the HIP has no size"}, kFrameUs, kMsPerMillionFacets}, nullptr,
      [](const MeshGeometry& geometry) {
        return MeshProbe(geometry.mesh, *geometry.index, geometry.crossings, geometry.sides);
      });
}

/// Information that all mesh renderers share.
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

}  // namespace

render::RendererInfo mesh_godobject_info() {
  render::RendererInfo info = mesh_renderer_info(kName, kSummary, kSource);
  info.make = [](const Options& options) { return make_point_on_mesh(kName, kSummary, kSource, options); };
  return info;
}

namespace {

constexpr const char* kProxyName = "mesh-proxy";
constexpr const char* kProxySummary = "a ball that stays outside of a triangle mesh";
constexpr const char* kProxySource =
    "Ruspini, Kolarov and Khatib 1997 (the thesis's [71]); exact moves and the skin as tip are ours";
/// Largest radius in edges: 2 mm at 0.02 mm spacing.
constexpr double kMaxEdges = 100.0;
// Measured median frame: docs/results/rivals.md.
constexpr double kProxyFrameUs = 3.1, kProxyMsPerMillionFacets = 380.0;

// Measured at a tip of 1,000 facets, where frames use every test: 16 ms for 65,536.
constexpr double kSphereTestMs = 2.4e-4;

/// One radius for the scene: the probe is one body.
struct SphereSize {
  double radius_mm = 0.0;
};

Status choose_radius(const Options& options, const MeshScene<SphereProbe>::Bodies& bodies, SphereSize& size,
                     render::PrepareReport& report) {
  double edge = std::numeric_limits<double>::infinity(), least = 0.0;
  for (const auto& body : bodies) {
    edge = std::min(edge, body->geometry->median_edge_mm);
    least = std::max(least, SphereProbe::least_radius_mm(body->mesh()));
  }
  const double given = options.number("radius_mm");
  size.radius_mm = given > 0.0 ? given : options.number("radius") * edge;
  report.notes.push_back(fmt::format("sphere: radius {:.4g} mm, {:.3g} median edges of the finest mesh",
                                     size.radius_mm, size.radius_mm / edge));
  if (size.radius_mm < least)
    return Error{fmt::format("a sphere of radius {:.3g} mm is below this mesh's rounding, {:.3g} mm",
                             size.radius_mm, least),
                 "take a larger radius, or radius=0 for a point"};
  return Done{};
}

render::Decision sphere_decision(const Options& options) {
  const double given_mm = options.number("radius_mm"), edges = options.number("radius");
  const std::string tip = ", followed by its " + options.text("tip");
  if (given_mm > 0.0) return {"probe", fmt::format("sphere of {:.4g} mm{}", given_mm, tip), "as given", true};
  return {"probe", fmt::format("sphere of {:.3g} median edges{}", edges, tip),
          "those of the scene's finest mesh: its size is known once there is a mesh", edges != 1.0};
}

std::unique_ptr<render::HapticRenderer> make_sphere(const Options& options) {
  const SphereTip tip = options.text("tip") == "centre" ? SphereTip::kCentre : SphereTip::kSkin;
  auto size = std::make_shared<SphereSize>();
  std::string bound = fmt::format(
      "{}a model: at most {} moves, {} tests of a facet against the sphere's way (one list of {} more), and "
      "two Embree queries a move (each O(log facets)); all of the tests take some {:.0f} ms",
      render::kLongerThanATick, kMaxSphereMoves, kMaxSphereTests, kMaxNearFacets,
      kSphereTestMs * static_cast<double>(kMaxSphereTests));
  return std::make_unique<MeshScene<SphereProbe>>(
      render::Description{kProxyName, kProxySummary, kProxySource, std::move(bound), options},
      MeshProbeKind{false, sphere_decision(options), kProxyFrameUs, kProxyMsPerMillionFacets},
      [options, size](const MeshScene<SphereProbe>::Bodies& bodies, render::PrepareReport& report) {
        return choose_radius(options, bodies, *size, report);
      },
      [tip, size](const MeshGeometry& geometry) {
        return SphereProbe(geometry.mesh, *geometry.index, size->radius_mm, geometry.median_edge_mm, tip);
      });
}

}  // namespace

render::RendererInfo mesh_proxy_info() {
  render::RendererInfo info = mesh_renderer_info(kProxyName, kProxySummary, kProxySource);
  for (OptionSpec& spec : info.options)  // a sphere rides over folds and gaps
    if (spec.key == "crossings") spec.only_with = {{"radius", {"0"}}, {"radius_mm", {"0"}}};
  info.options.push_back(option::number("radius", "1",
                                        "of the sphere, in median edges of the finest mesh; 0: a point", 0.0,
                                        kMaxEdges, {{"radius_mm", {"0"}}}));
  info.options.push_back(option::number("radius_mm", "0", "of the sphere, in mm; 0: as `radius` says", 0.0,
                                        std::numeric_limits<double>::max()));
  info.options.push_back(option::choice("tip", "skin",
                                        "what touches first: skin, force from the surface on; centre, force "
                                        "from a radius before it, as printed",
                                        {"skin", "centre"}, {{"radius", {"0"}, true}}));
  info.make = [](const Options& options) -> std::unique_ptr<render::HapticRenderer> {
    if (options.number("radius") == 0.0 && options.number("radius_mm") == 0.0)
      return make_point_on_mesh(kProxyName, kProxySummary, kProxySource, options);
    return make_sphere(options);
  };
  return info;
}

}  // namespace palpate::baselines
