// Settings and their variations: a renderer with options, a coordinate precision and a loop rate.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <palpate/registry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include "experiments/run/arguments.h"

namespace palpate::experiments {

struct Setting {
  /// "cloud:refine=1", then ":precision_bits=12" and ":rate_divisor=2" unless 0 and 1. Equal texts mean equal
  /// settings.
  std::string text;
  RendererRequest request;  ///< labelled by the text
  Options given;            ///< options as a user writes them, "clean" included
  /// Rounds coordinates to this many bits of the model's largest extent before preparation; 0: as stored.
  int precision_bits = 0;
  int rate_divisor = 1;           ///< uses every n-th sample of the path and holds its force
  std::vector<std::string> axes;  ///< axes with unusual values, in the order of axes()
};

/// One thing that can be varied.
struct Axis {
  std::string name, help;
};
/// All axes, in the order of `--axes`' help.
[[nodiscard]] const std::vector<Axis>& axes();
/// Parses "shading,points": known names, no repetition; empty: all.
[[nodiscard]] Result<std::vector<std::string>> parse_axes(const std::string& text);

struct SettingsRequest {
  std::vector<RendererRequest> renderers;  ///< base renderers; empty: all that suit the scene
  std::vector<std::string> axes;           ///< the varied ones
  bool full = false;                       ///< more values, and three variations at once
  double resolution_mm = 0.0;              ///< the first model's; box sizes are multiples of it
};

/// Settings in the order of measurement: every renderer with defaults, then single variations, pairs, and
/// triples with `full`, so a limited time yields the most informative ones. Omits settings that the renderer
/// refuses (an option without effect). Deterministic over machines.
[[nodiscard]] std::vector<Setting> settings_of(const SettingsRequest& request,
                                               const render::SceneInput& scene,
                                               const render::Registry& registry);

}  // namespace palpate::experiments
