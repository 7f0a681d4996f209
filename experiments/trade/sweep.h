// `palpate compare sweep` and `palpate compare merge`: measure settings within a time budget, keep rows, draw
// fronts.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "experiments/driver/study_run.h"
#include "experiments/driver/suite.h"
#include "experiments/trade/document.h"
#include "experiments/trade/measure.h"

namespace palpate::experiments {

inline constexpr double kSweepBudgetS = 600.0;
/// Default path length: six seconds, some thousand contact frames in twenty entries.
inline constexpr int kSweepFrames = 6'000;

struct SweepArguments {
  RunArguments run;        ///< scene, renderers, path, truth, folder, model, json
  std::string axes;        ///< empty: all
  double budget_s = -1.0;  ///< below 0: kSweepBudgetS, or none with `full`
  bool full = false;
  bool tunes = false;  ///< for a tune: without rates and precision, which a scene file cannot set
};

/// A sweep in progress: its folder, the rows of earlier ones in it, and settings to measure.
class Sweep {
 public:
  /// Checks every argument, loads the scene and reads earlier rows. Errors: bad input.
  [[nodiscard]] static Result<std::unique_ptr<Sweep>> begin(const SweepArguments& arguments,
                                                            const render::Registry& registry,
                                                            Context& context);
  /// Measures within the budget. Rows, the suite's record, are saved after every turn.
  [[nodiscard]] Status measure_all();
  [[nodiscard]] const SweepDocument& document() const { return document_; }
  [[nodiscard]] const Suite& suite() const { return suite_; }
  [[nodiscard]] const CheckedRun& checked() const { return checked_; }
  [[nodiscard]] const Experiment& experiment() const { return *experiment_; }

 private:
  explicit Sweep(Context& context) : suite_(context) {}
  /// Texts of settings that need no further turn.
  [[nodiscard]] std::set<std::string> done(double prepare_limit_s) const;
  [[nodiscard]] std::vector<Setting> next_turn(double prepare_limit_s) const;
  /// Settings that remain and are measured by this process; others are listed (Suite::measures).
  [[nodiscard]] std::vector<Setting> left_here() const;
  void take(std::vector<Row> rows);

  CheckedRun checked_;
  Stage stage_;
  std::optional<Experiment> experiment_;
  Suite suite_;
  std::vector<Setting> settings_;
  std::set<std::string> apart_;  ///< texts of settings that processes of one case measured, wherever
  std::optional<Setting> anchor_;
  SweepDocument document_;
  MeasureOptions measure_;
  const render::Registry* registry_ = nullptr;
  std::string machine_;
};

/// Writes rows, document and page; prints the fronts, the number of settings and where the page is, or the
/// document.
[[nodiscard]] Status publish_sweep(const SweepDocument& document, const Suite& suite, bool json);
/// Returns the exit status.
[[nodiscard]] Result<int> run_sweep(const SweepArguments& arguments, Context& context);

struct MergeArguments {
  std::vector<std::string> folders;
  std::string out;
  bool json = false;
};
[[nodiscard]] Result<int> run_merge(const MergeArguments& arguments, Context& context);

// `palpate tune`: finds the cheapest setting within an error limit, or the most accurate one within time or
// memory limits. Uses a sweep and verifies the written scene.

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
