// Control around a renderer: virtual coupling, force filter and passivity as stages after its frame, each
// only where it is asked for.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "toolkit/control/force_filter.h"
#include "toolkit/control/passivity.h"
#include "toolkit/control/virtual_coupling.h"
#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"

namespace palpate::control {

/// What a scene asks for; nothing by default.
struct ControlOptions {
  std::optional<Coupling> coupling;
  ForceFilterOptions filter;
  std::optional<PassivityOptions> passivity;
  [[nodiscard]] bool any() const noexcept { return coupling || filter.any() || passivity; }
};

/// The first thing that is wrong, or nothing.
[[nodiscard]] Status check(const ControlOptions& options);

/// One line a stage that is on, with its numbers.
[[nodiscard]] std::vector<std::string> describe(const ControlOptions& options);

/// The renderer with control around it, a renderer itself. Without any option it is `renderer`: what is off
/// costs nothing, not even a call. The stages come in this order, composed when it is made:
///
///   renderer -> coupling -> filter -> passivity -> force limit
///
/// The scene's force limit is applied once, at the end, to what the stages answer; the inner renderer is
/// prepared without one, so that a coupling sees the model's true stiffness. Contact, god object, model,
/// status and counters are the renderer's own, and a HIP that is not finite leaves every stage as it was.
/// `options` must satisfy check() (asserted). At most some 1000 instructions a frame more; no allocation.
[[nodiscard]] std::unique_ptr<render::HapticRenderer> wrap(std::unique_ptr<render::HapticRenderer> renderer,
                                                           const ControlOptions& options);

}  // namespace palpate::control
