// The whole of `palpate tune`: the cheapest setting that is accurate enough, or the most accurate one within
// a budget of time or memory, found by a sweep and checked by running the scene that is written.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "experiments/trade/sweep.h"

namespace palpate::experiments {

inline constexpr const char* kTuneFile = "tune.json";
inline constexpr const char* kTunedScene = "tuned.toml";
inline constexpr const char* kTuneSchema = "palpate-tune/1";
inline constexpr double kTuneBudgetS = 300.0;

/// What is asked for; at least one. Every limit holds for the upper end of a number's interval.
struct TuneLimits {
  std::optional<double> error_percent;  ///< 95th percentile
  std::optional<double> frame_us;       ///< 99.9 % of all frames
  std::optional<double> bytes;          ///< of the renderer, all told
  [[nodiscard]] bool any() const { return error_percent || frame_us || bytes; }
};

/// By how much a row misses what is asked for: the largest ratio of a number to its limit, at most 1 where it
/// keeps all. Infinite for a row that is not ok.
[[nodiscard]] double excess(const Row& row, const TuneLimits& limits);

/// Rows that keep every limit, the best first: with a limit of error by load, those that cannot be told apart
/// by memory; without one by error, those within kSameError by load. Indices into `rows`.
[[nodiscard]] std::vector<std::size_t> candidates(const std::vector<Row>& rows, const TuneLimits& limits);
/// The row that misses by least; nothing where none ran to its end.
[[nodiscard]] std::optional<std::size_t> nearest_miss(const std::vector<Row>& rows, const TuneLimits& limits);

struct TuneArguments {
  SweepArguments sweep;
  double max_error = -1.0, max_frame_us = -1.0, max_bytes = -1.0;  ///< below 0: not asked for
};
/// The exit status: 1 where nothing keeps the limits.
int run_tune(const TuneArguments& arguments, Context& context);

/// The scene with this renderer ("clean" among its options), as the text of a scene file that can stand
/// anywhere: paths are absolute, and what the command line said of models stands in it.
[[nodiscard]] Result<std::string> tuned_scene(const CheckedRun& checked, const ModelArguments& load,
                                              const NamedOptions& renderer);

}  // namespace palpate::experiments
