// Renderers of a live session: made at its beginning, and made anew while it runs where a parameter changes.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "experiments/run/arguments.h"
#include "experiments/run/stage.h"
#include "toolkit/control/controlled_renderer.h"
#include "toolkit/render/model_store.h"
#include "toolkit/render/registry.h"

namespace palpate::experiments {

/// Everything that a renderer is made of, but its own options. Lives as long as the session.
struct Workshop {
  const Stage& stage;
  const render::Registry& registry;
  int threads = 0;
  render::ModelStore store{};                 ///< geometry is built once for all renderers, early and late
  const render::SceneInput* other = nullptr;  ///< what is rendered in place of the stage's scene; null: that

  /// Whether passivity goes around all renderers together: a replay of one alone then answers otherwise.
  [[nodiscard]] bool passivity_apart() const { return stage.scene.control.passivity.has_value(); }
  /// What goes around each renderer: coupling and filter. Passivity goes around the mixer.
  [[nodiscard]] control::ControlOptions around_each() const {
    control::ControlOptions options = stage.scene.control;
    options.passivity.reset();
    return options;
  }
};

/// What a renderer is to be: a request, and what of the scene it changes for itself.
struct LiveSetting {
  RendererRequest request;
  double stiffness_n_per_mm = 0.0;  ///< 0: the scene's
  double force_limit_n = -1.0;      ///< below 0: the scene's; 0: none
};

struct MadeRenderer {
  std::unique_ptr<render::HapticRenderer> renderer;
  render::PrepareReport report;
};
/// Prepared, with control around it, not yet placed. May take long. Errors name the renderer.
[[nodiscard]] Result<MadeRenderer> make_live(Workshop& workshop, const LiveSetting& setting,
                                             Progress& progress);

/// At `at_s` of the session the renderer of a lane becomes another one.
struct LiveChange {
  double at_s = 0.0;
  std::size_t lane = 0;
  LiveSetting setting;
};
/// "2:cloud:stiffness=0.8,4:cloud:shading=none:force_limit=2": at a time in s a label's options, each change
/// on top of those before; stiffness in N/mm and force_limit in N are the scene's for this renderer alone. In
/// the order of time. Errors name the part that is wrong.
[[nodiscard]] Result<std::vector<LiveChange>> parse_changes(const std::string& text,
                                                            const std::vector<LiveSetting>& at_start,
                                                            const render::Registry& registry);

}  // namespace palpate::experiments
