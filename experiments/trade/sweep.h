// `palpate compare sweep` and `palpate compare merge`: measure settings within a time budget, keep rows, draw
// fronts.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "experiments/session/study_run.h"
#include "experiments/trade/document.h"
#include "experiments/trade/measure.h"

namespace palpate::experiments {

inline constexpr double kSweepBudgetS = 600.0;
/// Default path length: six seconds, some thousand contact frames in twenty entries.
inline constexpr int kSweepFrames = 6'000;

struct SweepArguments {
  RunArguments run;        ///< scene, renderers, path, truth, folder, model, json
  std::string axes;        ///< empty: all
  std::string shard;       ///< "2/8"
  double budget_s = -1.0;  ///< below 0: kSweepBudgetS, or none with `full`
  bool full = false;
  bool of_scene_only = false;  ///< without rates and precision, which a scene file cannot set (tune)
};

/// A sweep in progress: its folder, earlier rows, and settings to measure.
class Sweep {
 public:
  /// Checks every argument, loads the scene and reads earlier rows. Errors: bad input.
  [[nodiscard]] static Result<std::unique_ptr<Sweep>> begin(const SweepArguments& arguments,
                                                            const render::Registry& registry,
                                                            Context& context);
  /// Measures within the budget. Saves rows after every few settings.
  [[nodiscard]] Status measure_all(Context& context);
  [[nodiscard]] const SweepDocument& document() const { return document_; }
  [[nodiscard]] const OutputFolder& folder() const { return *folder_; }
  [[nodiscard]] const CheckedRun& checked() const { return checked_; }
  [[nodiscard]] const Experiment& experiment() const { return *experiment_; }

 private:
  Sweep() = default;
  [[nodiscard]] Status open_folder(const std::string& out);
  /// Texts of settings that need no further turn.
  [[nodiscard]] std::set<std::string> done(double prepare_limit_s) const;
  [[nodiscard]] std::vector<Setting> next_turn(double prepare_limit_s) const;
  void take(std::vector<Row> rows);

  CheckedRun checked_;
  Stage stage_;
  std::optional<Experiment> experiment_;
  std::optional<OutputFolder> folder_;
  bool folder_is_ours_ = false;  ///< the folder is an earlier sweep's
  std::vector<Setting> settings_;
  std::optional<Setting> anchor_;
  SweepDocument document_;
  MeasureOptions measure_;
  const render::Registry* registry_ = nullptr;
  std::string machine_;
};

/// Prints the fronts, the number of settings and the report's path; or the document.
void print_sweep(const SweepDocument& document, const OutputFolder& folder, bool json, bool verbose);
/// Returns the exit status.
[[nodiscard]] Result<int> run_sweep(const SweepArguments& arguments, Context& context);

struct MergeArguments {
  std::vector<std::string> folders;
  std::string out;
  bool json = false;
};
[[nodiscard]] Result<int> run_merge(const MergeArguments& arguments, Context& context);

}  // namespace palpate::experiments
