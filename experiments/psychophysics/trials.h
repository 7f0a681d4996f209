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
#include <string_view>
#include <vector>

#include <palpate/registry.h>
#include <palpate/result.h>
#include "experiments/psychophysics/observers.h"
#include "experiments/psychophysics/procedures.h"
#include "experiments/psychophysics/psychometric.h"
#include "experiments/study/study.h"

namespace palpate::experiments::psychophysics {

// A blinded study's plan: everything decided beforehand, as a TOML file.

enum class ProcedureKind : std::uint8_t { kFixed, kUpDown, kPsi };
/// "fixed", "up-down", "psi".
[[nodiscard]] const char* name_of(ProcedureKind kind) noexcept;

/// Long enough for a press or short stroke and lifting off.
inline constexpr double kUsualIntervalS = 1.5;
/// Largest accepted plan file.
inline constexpr std::uint64_t kMostPlanBytes = std::uint64_t{1} << 20;

/// A varied option: the values compared are standard - level or standard + level.
struct OptionUnderTest {
  std::string renderer;  ///< NAME[:option=value...]
  std::string key;       ///< numeric option of the renderer, or stiffness, spacing, noise, rate
  std::string unit;      ///< of standard and levels; "1": none
  double standard = 0.0;
  bool upwards = true;
  /// The option's value at a difference.
  [[nodiscard]] double value_at(double level) const noexcept {
    return upwards ? standard + level : standard - level;
  }
};

/// Preregistered exclusion rules for trials and participants.
struct Exclusions {
  std::uint64_t missed_deadlines = 0;  ///< more in a trial exclude it
  std::uint64_t clipped_frames = 0;
  double fastest_s = 0.0, slowest_s = 1e9;  ///< answers outside are excluded
  double catch_share = 0.0;                 ///< a lower share right in catch trials excludes the participant
};

struct PowerWish {
  double wanted = kUsualPower, alpha = kUsualAlpha;
  double detect = 0.65;       ///< share of right answers to be detected
  double equivalence = 0.65;  ///< bound on the share that a null result shall support
};

struct Plan {
  std::string name, text;  ///< the file's name and full text
  std::string title, scene, participant = "P01";
  std::uint64_t seed = 1;
  Task task = Task::kAbx;
  std::string a, b;  ///< renderers; empty where an option is varied
  std::optional<OptionUnderTest> option;
  ProcedureKind procedure = ProcedureKind::kFixed;
  std::uint64_t count = 0;     ///< counted trials: in all, or at each level
  std::vector<double> levels;  ///< kFixed: differences, rising
  std::uint64_t practice = 0, catch_every = 0, break_every = 0;
  double catch_level = 0.0;  ///< an option's unmissable difference
  double switch_delay_s = 0.5;
  double interval_s = kUsualIntervalS;  ///< each interval's length, where renderers are felt
  UpDownOptions up_down;
  PsiOptions psi;
  Shape shape = Shape::kDprime;
  std::optional<double> slope;  ///< empty: fitted (kFixed), or kUsualSlope
  double lapse = 0.0;
  PowerWish power;
  Exclusions exclusions;

  [[nodiscard]] bool compares() const noexcept { return !option.has_value(); }
  /// Equally frequent orders of a trial: 4 of abx and same-different, else 2.
  [[nodiscard]] std::size_t cells() const noexcept {
    return task == Task::kAbx || task == Task::kSameDifferent ? 4 : 2;
  }
  /// Adaptive procedures assume a slope.
  [[nodiscard]] std::optional<double> fitted_slope() const noexcept {
    if (slope || procedure == ProcedureKind::kFixed) return slope;
    return kUsualSlope;
  }
  [[nodiscard]] Psychometric like() const noexcept { return {task, shape, 1.0, kUsualSlope, lapse}; }
};

/// Checks renderers and options against `registry`. Errors name file, line, column and remedy.
[[nodiscard]] Result<Plan> parse_plan(std::string_view text, const std::string& name,
                                      const render::Registry& registry);
/// A participant's code: at most 32 letters, digits, - and _.
[[nodiscard]] bool is_participant_code(std::string_view code) noexcept;
/// The text of a file or a named example. Errors list the examples.
struct PlanText {
  std::string name, text;
};
[[nodiscard]] Result<PlanText> read_plan(const std::string& file_or_example);

/// Example plans, in the page's order.
[[nodiscard]] const std::vector<PlanText>& example_plans();

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

// The record of a study while it goes on. Rows as they arrive: each is in the file before the next question.
// Sessions at the device, their scheduling and timing: sessions.jsonl has a line per session, for studies of
// several sessions.

inline constexpr const char* kSessionsFile = "sessions.jsonl";

/// One session. Lateness runs from a tick's due time to its start.
struct SessionRecord {
  std::string started_utc;
  std::uint64_t first_trial = 0, last_trial = 0;  ///< answered in it; 0: none
  bool real_time = true;                          ///< false: virtual clock
  std::string scheduling;                         ///< granted by the system
  std::vector<std::string> notes;                 ///< what was not granted; the device's facts
  double rate_hz = 0.0;
  std::uint64_t ticks = 0, missed = 0;  ///< missed: whole periods without a tick
  double late_p50_us = 0.0, late_p99_us = 0.0, late_p999_us = 0.0, late_most_us = 0.0;
  /// Frames of answered trials: all, and those that stepped every renderer.
  std::uint64_t trial_frames = 0, whole_frames = 0;
  std::uint64_t watchdog_trips = 0;
  std::uint64_t begun_again = 0;  ///< trials stopped by a fault
};

/// One line without its end.
[[nodiscard]] std::string session_line(const SessionRecord& session);
/// Reads a folder's sessions; empty if there were none.
[[nodiscard]] Result<std::vector<SessionRecord>> read_sessions(const OutputFolder& folder);
/// Writes all sessions; the file is complete or unchanged.
[[nodiscard]] Status write_sessions(const OutputFolder& folder, const std::vector<SessionRecord>& sessions);

/// One thread at a time. Refers to plan, rows and observer.
class Ledger {
 public:
  /// `rows`: earlier sessions' rows; new ones are appended. `stop_after`: trials of this session; 0: all.
  Ledger(const Plan& plan, const std::string& observer, std::vector<Row>& rows, TrialFile file,
         long long stop_after);

  /// True once this session has asked its trials.
  [[nodiscard]] bool session_over() const noexcept { return stop_after_ > 0 && asked_ == stop_after_; }
  /// Empty: the study is complete. Error: excluded answers keep it from ever ending.
  [[nodiscard]] Result<std::optional<Trial>> next() const;
  /// Enters the answer to `trial`, which must be next(). The system has it when this returns.
  [[nodiscard]] Status enter(const Trial& trial, const Answer& answer);

 private:
  const Plan& plan_;
  const std::string& observer_;
  std::vector<Row>& rows_;
  TrialFile file_;
  Course course_;
  long long stop_after_, asked_ = 0;
};

}  // namespace palpate::experiments::psychophysics
