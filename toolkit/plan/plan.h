// What will be built for a scene, and why: which renderer it takes where nobody names one, and what that one
// decides (HapticRenderer::decide), as text.
#pragma once

#include <optional>
#include <string>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/render/decision.h"
#include "toolkit/render/registry.h"
#include "toolkit/render/renderer.h"

namespace palpate::plan {

struct Plan {
  NamedOptions renderer;      ///< what replay and compare run where nobody names one
  render::Decisions decided;  ///< by that renderer, the choice of it first
};

/// Asks the renderer, which is neither prepared nor run. `wanted`: the one that the scene or the command line
/// names, or none. Errors: those of making it and of its decide().
[[nodiscard]] Result<Plan> make_plan(const render::SceneInput& scene,
                                     const std::optional<NamedOptions>& wanted,
                                     const render::Registry& registry, const render::PrepareContext& context);

/// The renderer a scene takes where nobody names one: `heightfield` for one height field as `info` and the
/// renderer define it (cloud/height_field_holes.h), else `cloud`; `cloud-smooth` for one model whose points
/// are so noisy, for their spacing and its stiffness, that it is felt. O(n log n).
[[nodiscard]] render::Decision choose_renderer(const render::SceneInput& scene,
                                               const render::PrepareContext& context = {});

/// As people read it.
[[nodiscard]] std::string text(const Plan& plan);

}  // namespace palpate::plan
