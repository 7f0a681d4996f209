// A study's trials: their order, and their file.
//
// A study is its plan and rows: order, level, catch and practice follow from them, so an interrupted study
// resumes from its file. A row is appended and flushed when answered, and never changed.
#pragma once

#include <cstdint>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <palpate/result.h>
#include "experiments/psychophysics/observers.h"
#include "experiments/psychophysics/plan.h"

namespace palpate::experiments::psychophysics {

enum class TrialKind : std::uint8_t { kPractice, kMain, kCatch };
/// "practice", "main", "catch".
[[nodiscard]] const char* name_of(TrialKind kind) noexcept;

struct Trial {
  std::uint64_t number = 0;  ///< from 1, over all kinds
  TrialKind kind = TrialKind::kMain;
  double level = 0.0;  ///< an option's difference; 0 in comparisons
  std::string shown;   ///< "ABA": a letter per interval; A is the standard, or the plan's a
  int right = 0;       ///< the right answer
  bool break_before = false;

  /// Switches between intervals; equal neighbours make sham switches with the same delay.
  [[nodiscard]] std::size_t switches() const noexcept { return shown.size() - 1; }
  [[nodiscard]] std::size_t sham_switches() const noexcept;
};

/// A trial with its answer.
struct Row {
  Trial trial;
  Answer answer;
  std::string excluded;  ///< reason by the preregistered rule; empty: counts
  [[nodiscard]] bool correct() const noexcept { return answer.choice == trial.right; }
};

/// Why this answer does not count; empty if it does.
[[nodiscard]] std::string exclusion_of(const Answer& answer, const Exclusions& rule);

/// The order of trials, deterministic in plan and answers.
class Course {
 public:
  explicit Course(const Plan& plan);
  /// Empty when the study is complete.
  [[nodiscard]] std::optional<Trial> next() const;
  /// Takes next()'s answer. An adaptive procedure ignores an excluded answer and asks again.
  void answered(const Row& row);
  /// The adaptive procedure, or null.
  [[nodiscard]] const Adaptive* procedure() const noexcept { return procedure_.get(); }
  /// A new procedure by the plan; null for fixed levels.
  [[nodiscard]] static std::unique_ptr<Adaptive> new_procedure(const Plan& plan);
  /// Counted trials of a fixed procedure.
  [[nodiscard]] static std::uint64_t fixed_trials(const Plan& plan) noexcept;

 private:
  const Plan& plan_;
  std::uint64_t seed_;  ///< from plan and participant: no two get the same order
  std::unique_ptr<Adaptive> procedure_;
  std::uint64_t done_ = 0, practised_ = 0, main_ = 0, catches_ = 0;
};

/// The unmissable difference of catch and practice trials; 0 in comparisons.
[[nodiscard]] double easiest_level(const Plan& plan) noexcept;

/// Seeds of a participant's order and of a simulated one's answers.
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

/// Rows of a file checked against plan, observer and course. Another study's file or a changed one is refused
/// with its line. `whole_bytes` excludes a last line cut off while being written.
struct ReadTrials {
  std::vector<Row> rows;
  std::uint64_t whole_bytes = 0;
};
[[nodiscard]] Result<ReadTrials> read_trials(const std::string& file, const Plan& plan,
                                             const std::string& observer);

/// Appends rows; the system has each before write() returns, so it outlives this process.
class TrialFile {
 public:
  /// Opens an existing file and truncates it to `whole_bytes`.
  [[nodiscard]] static Result<TrialFile> append_to(const std::string& file, std::uint64_t whole_bytes);
  [[nodiscard]] Status write(const std::string& row);

 private:
  TrialFile(std::string path, std::ofstream file) : path_(std::move(path)), file_(std::move(file)) {}
  std::string path_;
  std::ofstream file_;
};

}  // namespace palpate::experiments::psychophysics
