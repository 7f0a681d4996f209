// The trials of a study: which comes next, and the file they are kept in.
//
// A study is its plan and its rows: everything else (order, level, what is catch and what is practice)
// follows from them, so a study that was interrupted goes on from its file. A row is written when the answer
// is there, appended and flushed, and never changed.
#pragma once

#include <cstdint>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "experiments/psychophysics/observers.h"
#include "experiments/psychophysics/plan.h"
#include "toolkit/core/result.h"

namespace palpate::experiments::psychophysics {

enum class TrialKind : std::uint8_t { kPractice, kMain, kCatch };
/// "practice", "main", "catch".
[[nodiscard]] const char* name_of(TrialKind kind) noexcept;

struct Trial {
  std::uint64_t number = 0;  ///< from 1, of all kinds
  TrialKind kind = TrialKind::kMain;
  double level = 0.0;  ///< difference of an option; 0 where renderers are compared
  std::string shown;   ///< "ABA": a letter an interval; A is the standard, or the plan's a
  int right = 0;       ///< the answer that is right
  bool break_before = false;

  /// Switches between intervals; those between two that are the same are shams, with the same delay.
  [[nodiscard]] std::size_t switches() const noexcept { return shown.size() - 1; }
  [[nodiscard]] std::size_t sham_switches() const noexcept;
};

/// A trial with its answer.
struct Row {
  Trial trial;
  Answer answer;
  std::string excluded;  ///< why it does not count, by the rule that was registered; empty: it counts
  [[nodiscard]] bool correct() const noexcept { return answer.choice == trial.right; }
};

/// Why this answer does not count, or nothing.
[[nodiscard]] std::string exclusion_of(const Answer& answer, const Exclusions& rule);

/// The order of trials. Deterministic in plan and answers.
class Course {
 public:
  explicit Course(const Plan& plan);
  /// Nothing when the study is complete.
  [[nodiscard]] std::optional<Trial> next() const;
  /// `row.trial` was next(). An excluded answer of a procedure that adapts is asked again: it moves nothing.
  void answered(const Row& row);
  /// The procedure, where one adapts; else null.
  [[nodiscard]] const Adaptive* procedure() const noexcept { return procedure_.get(); }
  /// A new one, as the plan has it; null where levels are fixed.
  [[nodiscard]] static std::unique_ptr<Adaptive> new_procedure(const Plan& plan);
  /// Trials that count, of a fixed procedure.
  [[nodiscard]] static std::uint64_t fixed_trials(const Plan& plan) noexcept;

 private:
  const Plan& plan_;
  std::uint64_t seed_;  ///< of the plan and the participant: no two get the same order
  std::unique_ptr<Adaptive> procedure_;
  std::uint64_t done_ = 0, practised_ = 0, main_ = 0, catches_ = 0;
};

/// The difference nobody misses: of catch and practice trials; 0 where renderers are compared.
[[nodiscard]] double easiest_level(const Plan& plan) noexcept;

/// The seed of a participant's order, and that of a simulated one's answers.
[[nodiscard]] std::uint64_t order_seed(const Plan& plan) noexcept;
[[nodiscard]] std::uint64_t answer_seed(const Plan& plan) noexcept;

inline constexpr const char* kTrialsFile = "trials.csv";
/// A column of the file.
struct Column {
  std::string name, unit, meaning;
};
[[nodiscard]] const std::vector<Column>& trial_columns();
[[nodiscard]] std::string csv_head();
[[nodiscard]] std::string csv_row(const Row& row, const Plan& plan, const std::string& observer);

/// Rows of a file, checked against the plan, the observer and the course: a file of another study, or one
/// that was changed, is refused with its line. `whole_bytes`: what is whole; a last line that was cut off in
/// the middle of being written is no row.
struct ReadTrials {
  std::vector<Row> rows;
  std::uint64_t whole_bytes = 0;
};
[[nodiscard]] Result<ReadTrials> read_trials(const std::string& file, const Plan& plan,
                                             const std::string& observer);

/// Appends rows; each is with the system before write() returns, so that it outlives this process.
class TrialFile {
 public:
  /// The file exists; what lies behind `whole_bytes` is taken off.
  [[nodiscard]] static Result<TrialFile> append_to(const std::string& file, std::uint64_t whole_bytes);
  [[nodiscard]] Status write(const std::string& row);

 private:
  TrialFile(std::string path, std::ofstream file) : path_(std::move(path)), file_(std::move(file)) {}
  std::string path_;
  std::ofstream file_;
};

}  // namespace palpate::experiments::psychophysics
