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

}  // namespace palpate::experiments
