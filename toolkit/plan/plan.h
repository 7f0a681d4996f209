// What will be built for a scene, and why: which renderer it takes where nobody names one, and what that one
// decides (HapticRenderer::decide), as text.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/plan/machine.h"
#include "toolkit/plan/pilot.h"
#include "toolkit/render/decision.h"
#include "toolkit/render/registry.h"
#include "toolkit/render/renderer.h"

namespace palpate::plan {

struct Plan {
  NamedOptions renderer;      ///< what replay and compare run where nobody names one
  render::Decisions decided;  ///< by that renderer, the choice of it first
  std::optional<Machine>
      machine;  ///< that `cost` was reckoned for; none: expected times are those of kExpectedOn
  std::optional<FrameCost> cost;   ///< of a frame on it
  std::vector<double> spacing_mm;  ///< of each model's points: the median of sqrt(area a point); 0: not known
  std::vector<std::string> warnings;
};

/// Asks the renderer, which is neither prepared nor run. `wanted`: the one that the scene or the command line
/// names, or none. Errors: those of making it and of its decide().
[[nodiscard]] Result<Plan> make_plan(const render::SceneInput& scene,
                                     const std::optional<NamedOptions>& wanted,
                                     const render::Registry& registry, const render::PrepareContext& context);

/// Puts what a frame will take on this machine in place of what it took where expected times were measured.
/// Where it cannot be told, the plan stays as it is.
void expect_on(Plan& plan, const render::SceneInput& scene, const render::Registry& registry,
               const std::string& path, Machine machine);

/// The renderer a scene takes where nobody names one: `heightfield` for one height field as `info` and the
/// renderer define it (cloud/height_field_holes.h), else `cloud`; `cloud-smooth` for one model whose points
/// are so noisy, for their spacing and its stiffness, that it is felt. O(n log n).
[[nodiscard]] render::Decision choose_renderer(const render::SceneInput& scene,
                                               const render::PrepareContext& context = {});

/// As people read it.
[[nodiscard]] std::string text(const Plan& plan);

}  // namespace palpate::plan
