// The plan of a scene: the renderer chosen if none is named, and its decisions (HapticRenderer::decide), as
// text.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <palpate/decision.h>
#include <palpate/options.h>
#include <palpate/registry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include "toolkit/plan/frame_cost.h"

namespace palpate::plan {

struct Plan {
  NamedOptions renderer;           ///< default of replay and compare
  render::Decisions decided;       ///< its decisions, its own choice first
  std::optional<Machine> machine;  ///< machine of `cost`; empty: expected times are for kReferenceMachine
  std::optional<FrameCost> cost;   ///< of a frame on it
  std::vector<double> spacing_mm;  ///< per model: the median of sqrt(area per point); 0: unknown
  std::vector<std::string> warnings;
};

/// Asks the renderer without preparing or running it. `wanted`: the one named by the scene or command line,
/// or none. Errors: those of making it and of its decide().
[[nodiscard]] Result<Plan> make_plan(const render::SceneInput& scene,
                                     const std::optional<NamedOptions>& wanted,
                                     const render::Registry& registry, const render::PrepareContext& context);

/// Replaces reference frame times by estimates for this machine; leaves the plan unchanged if that is
/// impossible.
void estimate_on_machine(Plan& plan, const render::SceneInput& scene, const render::Registry& registry,
                         const std::string& path, Machine machine);

/// The renderer for a scene that names none: `heightfield` for a single height field (as defined for `info`,
/// cloud/height_field.h), else `cloud`, or `cloud-smooth` for one model with noise that is felt at its
/// spacing and stiffness. O(n log n).
[[nodiscard]] render::Decision choose_renderer(const render::SceneInput& scene,
                                               const render::PrepareContext& context = {});

/// For the user.
[[nodiscard]] std::string text(const Plan& plan);

}  // namespace palpate::plan
