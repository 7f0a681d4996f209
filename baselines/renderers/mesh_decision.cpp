#include "baselines/renderers/mesh_decision.h"

#include <fmt/format.h>

#include <utility>

namespace palpate::baselines {
namespace {

using render::Decision;

/// Measured: mesh, links of facets, tree.
constexpr double kBytesPerFacet = 196.0;
/// Of decimation, 500,000 facets (docs/meshes.md).
constexpr double kDecimateMsPerMillion = 40'000.0;
constexpr double kPerMillion = 1e-6;

Decision repair_decision(const MeshDecision& d) {
  if (d.repairs)
    return {"repair", "on", "oriented, cut where too many facets meet, small holes filled", true};
  return {"repair", "none", "the mesh is felt as it is"};
}

Decision refine_decision(const MeshDecision& d) {
  if (d.smoothing == 0 && !(d.keeps < 1.0))
    return {"facets", "all, where they are", "nothing asks for fewer"};
  std::string choice = d.keeps < 1.0 ? fmt::format("{:.3g} of them", d.keeps) : "all";
  if (d.smoothing > 0) choice += fmt::format(", smoothed {} times", d.smoothing);
  return {"facets", std::move(choice), "as given", true};
}

Decision frame_decision(const MeshDecision& d) {
  if (d.frame == MeshFrame::kWorld)
    return {"frame", "the file's", "as given: far from its origin single precision loses the mesh", true};
  return {"frame", "the mesh's own middle", "single precision resolves the mesh wherever it lies"};
}

Decision check_decision(const MeshDecision& d) {
  if (d.checks) return {"check", "pieces and borders", "as given: for people, frames do not read it", true};
  return {"check", "none", "frames do not need it"};
}

Decision crossing_decision(const MeshDecision& d, const MeshProbeKind& kind) {
  if (d.crossings)
    return {"crossing facets", "found", "as given: where sheets cross, both hold a point", true};
  return {"crossing facets", "not looked for",
          kind.crossings ? "Zilles and Salisbury look for none" : "a sphere rides over folds and gaps"};
}

}  // namespace

Result<MeshDecision> decide_body(const render::ModelInput& input, const Options& options,
                                 const MeshProbeKind& kind) {
  Result<MeshSource> source = decide_mesh(input, options);
  if (!source.ok()) return std::move(source).error();
  Result<render::SurfaceDecision> surface = render::decide_surface(input);
  if (!surface.ok()) return std::move(surface).error();
  MeshDecision decided;
  decided.source = std::move(source).value();
  decided.repairs = options.flag("repair");
  decided.smoothing = options.integer("smooth");
  decided.keeps = options.number("decimate");
  decided.normals = options.text("shading") == "interpolated";
  if (options.text("frame") == "world") decided.frame = MeshFrame::kWorld;
  decided.point = kind.crossings;
  decided.checks = options.flag("check");
  decided.crossings = kind.crossings && options.flag("crossings");
  decided.surface = std::move(surface).value();
  return decided;
}

render::ModelDecisions said(const render::ModelInput& input, const MeshDecision& decision,
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
  out.decisions.push_back(decision.source.said);
  out.decisions.push_back(repair_decision(decision));
  out.decisions.push_back(refine_decision(decision));
  out.decisions.push_back(kind.probe);
  out.decisions.push_back(frame_decision(decision));
  out.decisions.push_back(check_decision(decision));
  out.decisions.push_back(crossing_decision(decision, kind));
  out.decisions.push_back(decision.normals
                              ? Decision{"shading", "interpolated vertex normals", "as given", true}
                              : Decision{"shading", "none", "a facet's own plane"});
  render::say_surface(input, decision.surface, kMeshFeels,
                      decision.source.made ? out.points : input.original_mesh->vertices_mm.size(), out);
  if (input.motion != nullptr)
    out.decisions.push_back({"motion", "pose read in each frame", "the scene moves it", true});
  return out;
}

}  // namespace palpate::baselines
