#include <palpate/decision.h>

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include <palpate/renderer.h>
#include "toolkit/core/tolerances.h"
#include "toolkit/render/shading.h"

namespace palpate::render {
namespace {

/// Cost of broad phase and model loop in each frame, from feature_cost.
constexpr double kManyUs = 0.02;

bool can_deform(const ModelInput& model) {
  return model.surface.dent.any() || model.moves != nullptr;
}

Decision broad_phase_decision(const SceneInput& scene, const SceneDecision& decided) {
  if (!decided.many) return {"broad phase", "none", "one model at rest: there is nothing to choose from"};
  const bool moves = std::any_of(scene.models.begin(), scene.models.end(),
                                 [](const ModelInput& model) { return model.motion != nullptr; });
  const std::string what =
      fmt::format("{} model{}{}", scene.models.size(), scene.models.size() > 1 ? "s" : "",
                  moves ? ", some of them moving" : "");
  if (decided.broad_phase)
    return {"broad phase", "tree of model boxes",
            what + ": a frame looks only at those near the HIP, wherever their points go"};
  return {"broad phase", "none", what + ": this renderer looks at every one in every frame"};
}

/// The sum, or nothing if a part is unknown.
std::optional<double> plus(const std::optional<double>& a, const std::optional<double>& b) {
  return a && b ? std::optional<double>(*a + *b) : std::nullopt;
}

}  // namespace

SceneDecision decide_scene(const SceneInput& scene, const LocalModelTraits& kind,
                           ContactCombination combine) {
  SceneDecision decided;
  decided.many = scene.models.size() > 1 ||
                 std::any_of(scene.models.begin(), scene.models.end(), [&](const auto& model) {
                   return model.motion != nullptr || (kind.changes && can_deform(model));
                 });
  decided.broad_phase = decided.many && kind.boxed;
  decided.combine = kind.sums ? ContactCombination::kSum : combine;
  decided.force_limit_n = scene.force_limit_n;
  return decided;
}

void describe_scene(const SceneInput& scene, const SceneDecision& scene_decision, Decisions& decided) {
  decided.decisions.push_back(broad_phase_decision(scene, scene_decision));
  if (scene.models.size() > 1)
    decided.decisions.push_back(
        scene_decision.combine == ContactCombination::kSum
            ? Decision{"models touched at once", "sum", "each answers for itself, and the forces are added"}
            : Decision{"models touched at once", "joint", "one god object is held by all of them together"});
  decided.decisions.push_back(force_limit_decision(scene_decision.force_limit_n));
  decided.prepare_ms = 0.0;
  decided.frame_us = scene_decision.many ? kManyUs : 0.0;
  std::optional<double> slowest = 0.0;
  for (const ModelDecisions& model : decided.models) {
    decided.bytes += model.bytes;
    decided.prepare_ms = plus(decided.prepare_ms, model.prepare_ms);
    slowest =
        slowest && model.frame_us ? std::optional<double>(std::max(*slowest, *model.frame_us)) : std::nullopt;
  }
  decided.frame_us = plus(decided.frame_us, slowest);
}

Decision force_limit_decision(double force_limit_n) {
  if (force_limit_n > 0.0)
    return {"force limit", fmt::format("{:.3g} N", force_limit_n), "the scene sets it", true};
  return {"force limit", "none", "the scene sets none; a device has its own"};
}

std::string note_text(const Decision& decision) {
  return fmt::format("{}: {}, {}", decision.about, decision.choice, decision.reason);
}

namespace {

constexpr const char* kAbout = "shading";

}  // namespace

ShadingDecision given_shading(const std::string& choice) {
  return {parse_shading(choice), {kAbout, choice, "as given", true}};
}

ShadingDecision decide_literal_shading(const std::string& choice, double resolution_mm) {
  if (choice != "auto") return given_shading(choice);
  ShadingDecision decided;
  const bool shade = resolution_mm > kLiteralShadingResolutionMm;
  if (shade) decided.shading = Shading::kAreaRaw;
  decided.explanation = {kAbout, shade ? "area-raw" : "none",
                         fmt::format("the resolution, {:.3g} mm, is {} {} mm (section 3.4)", resolution_mm,
                                     shade ? "above" : "at most", kLiteralShadingResolutionMm)};
  return decided;
}

}  // namespace palpate::render
