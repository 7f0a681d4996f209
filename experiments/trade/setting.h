// What users can turn, and every way in which it is turned: a setting is one renderer with its options, the
// precision that coordinates are kept at, and the rate of the loop.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "experiments/run/arguments.h"
#include "toolkit/core/result.h"
#include "toolkit/render/registry.h"
#include "toolkit/render/renderer.h"

namespace palpate::experiments {

struct Setting {
  /// "cloud:refine=1", then ":precision_bits=12" and ":rate_divisor=2" where they are not 0 and 1. Two
  /// settings of one text are one and the same.
  std::string text;
  RendererRequest request;  ///< its label is the text
  Options given;            ///< its options as a user would write them, "clean" among them
  /// Coordinates are rounded to this many bits of the model's largest extent before anything is prepared;
  /// 0: as they are stored.
  int precision_bits = 0;
  int rate_divisor = 1;           ///< every so many samples of the path are a frame, whose force is then held
  std::vector<std::string> axes;  ///< the axes on which it is not as usual, in the order of axes()
};

/// One thing that can be turned.
struct Axis {
  std::string name, help;
};
/// All of them, in the order of `--axes`' help.
[[nodiscard]] const std::vector<Axis>& axes();
/// "shading,points": known names, no name twice; empty: all.
[[nodiscard]] Result<std::vector<std::string>> parse_axes(const std::string& text);

struct SettingsRequest {
  std::vector<RendererRequest> renderers;  ///< to start from; empty: all that the scene can be given to
  std::vector<std::string> axes;           ///< those that are turned
  bool full = false;                       ///< more values, and three things turned at once too
  double resolution_mm = 0.0;              ///< of the first model: boxes are multiples of it
};

/// In the order in which they are measured: first every renderer as usual, then one thing turned at a time,
/// then two at once, with `full` three too: whatever time is left over, the settings that
/// were measured are those that tell most. What a renderer refuses (an option that would not act) is no
/// setting. The same arguments give the same list on every machine.
[[nodiscard]] std::vector<Setting> settings_of(const SettingsRequest& request,
                                               const render::SceneInput& scene,
                                               const render::Registry& registry);

/// The part of one shard, counted from 0: every `count`-th.
[[nodiscard]] std::vector<Setting> shard_of(std::vector<Setting> all, std::size_t shard, std::size_t count);

}  // namespace palpate::experiments
