// Settings measured on a stage, some at a time and in turns: what they cost, and how far from the truth they
// are.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "experiments/run/run.h"
#include "experiments/trade/row.h"
#include "experiments/trade/setting.h"

namespace palpate::experiments {

/// Settings that take turns with each other: drift of the machine within them is shared by all.
inline constexpr std::size_t kInTurns = 8;
/// Preparations of one setting, each in a process of its own; slow ones get one.
inline constexpr std::uint64_t kPreparations = 3;
/// Passes of each kind in a sweep: a sweep has a hundred settings, not three.
inline constexpr std::uint64_t kSweepPasses = 10;

struct MeasureOptions {
  int threads = 0;
  std::uint64_t passes = kSweepPasses;
  double budget_s = 2.0;  ///< of one setting's timed passes: a slow one gets fewer
  double prepare_limit_s = 60.0;
};

/// What all settings of a sweep have in common.
struct Experiment {
  const Stage* stage = nullptr;  ///< with a truth; outlives this
  std::string hash;              ///< of models, path, truth, control and program
  double rate_hz = 0.0;
  double truth_rms_n = 0.0;  ///< of the true force over its contact frames: what 100 % of error is
  std::vector<std::uint32_t> episode_of;  ///< by frame, see metrics::Accuracy
  std::size_t episodes = 1;
};
/// An Error where the stage has no truth that forces can be compared with, or never touches.
[[nodiscard]] Result<Experiment> experiment_on(const Stage& stage, const std::string& program);

/// The stage as a setting sees it: rounded coordinates, every so many samples of the path, and no surface to
/// ask, which only scores need that no row has.
[[nodiscard]] Stage stage_seen(const Stage& stage, int precision_bits, int rate_divisor);

/// The force of every frame held until the next one, over the whole path.
[[nodiscard]] trace::ForceTrace held(const trace::ForceTrace& trace, const trace::ProbePath& path,
                                     int rate_divisor);

/// 95th percentile of the error in percent of the true force, with its interval over episodes. Nothing where
/// nothing was in contact.
[[nodiscard]] std::optional<Measured> error_p95(const Experiment& experiment, const Run& run);

/// A row for each, in their order. All must have the same precision and rate. The anchor takes turns with
/// them. An Error is bad input of the stage; a setting that fails or is too slow has a row that says so.
[[nodiscard]] Result<std::vector<Row>> measure(const Experiment& experiment,
                                               std::span<const Setting> settings, const Setting& anchor,
                                               const render::Registry& registry,
                                               const MeasureOptions& options, Progress& progress);

}  // namespace palpate::experiments
