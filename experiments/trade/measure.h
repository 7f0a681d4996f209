// Measures settings in turns on a stage: cost and error.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "experiments/run/run.h"
#include "experiments/trade/row.h"
#include "experiments/trade/setting.h"

namespace palpate::experiments {

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
