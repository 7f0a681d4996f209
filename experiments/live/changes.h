// Creates the renderers of a live session at its start and after each parameter change.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <palpate/control.h>
#include <palpate/model_store.h>
#include <palpate/registry.h>
#include "experiments/run/arguments.h"
#include "experiments/run/stage.h"

namespace palpate::experiments {

/// Everything renderers are made from except their own options. Lives as long as the session.
struct Workshop {
  const Stage& stage;
  const render::Registry& registry;
  int threads = 0;
  render::ModelStore store{};                 ///< shares built geometry between all renderers
  const render::SceneInput* other = nullptr;  ///< rendered instead of the stage's scene; null: the stage's
                                              ///< scene

  /// True if passivity control encloses all renderers together; a single renderer's replay then differs.
  [[nodiscard]] bool passivity_apart() const { return stage.scene.control.passivity.has_value(); }
  /// Control around each renderer: coupling and filter. Passivity control encloses the mixer.
  [[nodiscard]] control::ControlOptions around_each() const {
    control::ControlOptions options = stage.scene.control;
    options.passivity.reset();
    return options;
  }
};

/// A renderer's request and its own changes of the scene.
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

/// Replaces a lane's renderer at `at_s` of the session.
struct LiveChange {
  double at_s = 0.0;
  std::size_t lane = 0;
  LiveSetting setting;
};
/// Parses "2:cloud:stiffness=0.8,4:cloud:refine=1:force_limit=2": at each time in s, options for a label, on
/// top of earlier changes. stiffness in N/mm and force_limit in N replace the scene's for this renderer
/// alone. Sorted by time. Errors name the invalid part.
[[nodiscard]] Result<std::vector<LiveChange>> parse_changes(const std::string& text,
                                                            const std::vector<LiveSetting>& at_start,
                                                            const render::Registry& registry);

}  // namespace palpate::experiments
