// `palpate tune`: finds the cheapest setting within an error limit, or the most accurate one within time or
// memory limits. Uses a sweep and verifies the written scene.
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

/// Requested limits, at least one, each on the upper end of a number's interval.
struct TuneLimits {
  std::optional<double> error_percent;  ///< 95th percentile
  std::optional<double> frame_us;       ///< of 99.9 % of all frames
  std::optional<double> bytes;          ///< of the renderer, in total
  [[nodiscard]] bool any() const { return error_percent || frame_us || bytes; }
};

/// Largest ratio of a number to its limit: at most 1 if all are kept, infinite for a row that is not ok.
[[nodiscard]] double excess(const Row& row, const TuneLimits& limits);

/// Indices of `rows` that keep every limit, best first. With an error limit: by load, then memory. Without:
/// by error, then load within kSameError.
[[nodiscard]] std::vector<std::size_t> candidates(const std::vector<Row>& rows, const TuneLimits& limits);
/// The row with the smallest excess; empty if none finished.
[[nodiscard]] std::optional<std::size_t> nearest_miss(const std::vector<Row>& rows, const TuneLimits& limits);

struct TuneArguments {
  SweepArguments sweep;
  double max_error = -1.0, max_frame_us = -1.0, max_bytes = -1.0;  ///< below 0: no limit
};
/// Returns the exit status: 1 if nothing keeps the limits.
[[nodiscard]] Result<int> run_tune(const TuneArguments& arguments, Context& context);

/// Text of a scene file with this renderer ("clean" among its options). It works in any folder: paths are
/// absolute and the command line's model settings are included.
[[nodiscard]] Result<std::string> tuned_scene(const CheckedRun& checked, const ModelArguments& load,
                                              const NamedOptions& renderer);

}  // namespace palpate::experiments
