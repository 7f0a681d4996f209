// Measures settings in turns on a stage: cost and error.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <palpate/registry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include "experiments/run/arguments.h"
#include "experiments/run/run.h"
#include "experiments/trade/row.h"

namespace palpate::experiments {

// Settings and their variations: a renderer with options, a coordinate precision and a loop rate.

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

/// Settings measured in turns, so that drift of the machine affects all alike.
inline constexpr std::size_t kInTurns = 8;
/// Preparations per setting, each in its own process; slow ones run once.
inline constexpr std::uint64_t kPreparations = 3;
/// Passes of each kind, few because a sweep has a hundred settings.
inline constexpr std::uint64_t kSweepPasses = 10;

struct MeasureOptions {
  int threads = 0;
  std::uint64_t passes = kSweepPasses;
  double budget_s = 2.0;  ///< for a setting's timed passes: slow ones get fewer
  double prepare_limit_s = 60.0;
};

/// Data common to a sweep's settings.
struct Experiment {
  const Stage* stage = nullptr;  ///< has a truth; must outlive this
  std::string hash;              ///< of models, path, truth, control and program
  double rate_hz = 0.0;
  double truth_rms_n = 0.0;               ///< the true force's RMS over its contact frames: 100 % of error
  std::vector<std::uint32_t> episode_of;  ///< by frame, see metrics::Accuracy
  std::size_t episodes = 1;
};
/// Error: the truth has no comparable forces, or the path never touches.
[[nodiscard]] Result<Experiment> experiment_on(const Stage& stage, const std::string& program);

/// The stage for a setting: rounded coordinates, a subsampled path, and no surface, which only unused scores
/// need.
[[nodiscard]] Stage stage_seen(const Stage& stage, int precision_bits, int rate_divisor);

/// Holds each frame's force until the next, over the whole path.
[[nodiscard]] trace::ForceTrace held(const trace::ForceTrace& trace, const trace::ProbePath& path,
                                     int rate_divisor);

/// 95th percentile of the error in percent of the true force, with its interval over episodes. Empty without
/// contact.
[[nodiscard]] std::optional<Measured> error_p95(const Experiment& experiment, const Run& run);

/// Measures settings of equal precision and rate in turns with the anchor; returns their rows in order.
/// Error: bad input of the stage. A failed or slow setting gets a row that says so.
[[nodiscard]] Result<std::vector<Row>> measure(const Experiment& experiment,
                                               std::span<const Setting> settings, const Setting& anchor,
                                               const render::Registry& registry,
                                               const MeasureOptions& options, Progress& progress);

}  // namespace palpate::experiments
