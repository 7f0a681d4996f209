// `palpate study`: runs a plan with an observer and writes trials.csv, study.json and report.html.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "experiments/live/session_device.h"
#include "experiments/psychophysics/trials.h"
#include "experiments/report/page.h"
#include "experiments/session/session.h"

namespace palpate::experiments::psychophysics {

inline constexpr const char* kObservedFile = "study.json";
/// Increases when a key is redefined or removed.
inline constexpr const char* kObservedSchema = "palpate-observed/1";
inline constexpr const char* kPlanFile = "plan.toml";

struct BlindedArguments {
  std::string plan;  ///< a file or an example's name
  std::string observer = "simulated:dprime=1";
  std::string out;           ///< empty: out/study-NAME
  std::string participant;   ///< empty: the plan's
  std::string save_plan;     ///< writes the plan to this file and stops
  long long stop_after = 0;  ///< trials in this session; 0: all
  DeviceArguments device;    ///< for machine and person
  double rate_hz = 1000.0;   ///< of the servo, a whole number
  bool accelerated = false;  ///< runs a person's session on a simulated device in virtual time
  bool lsl = false;          ///< sends markers of a person's session to Lab Streaming Layer
  std::string lsl_library;   ///< empty: kLslLibrary
  bool power = false;        ///< prints the power table and stops; with Context::verbose it is only printed
  bool json = false;
};

// Analyses a study's trials: pure functions of plan and rows.

/// The result of a study that compares two renderers.
struct Difference {
  Answers answers;
  Estimate share;              ///< share of right answers, with the Clopper-Pearson interval
  double p = 1.0;              ///< probability of at least as many right answers by chance
  double equivalence_p = 1.0;  ///< probability of at most as many if the share is the bound
  std::optional<Sensitivity> differencing, independent;  ///< the second if it differs
};

/// The result of a study that varies an option.
struct Threshold {
  std::vector<LevelAnswers> levels;
  PsychometricFit fit;
  Estimate jnd;                       ///< in the option's unit
  std::string method;                 ///< of the value and interval
  std::optional<Estimate> procedure;  ///< the procedure's own estimate
  std::string procedure_says;         ///< what it estimates
};

struct Analysis {
  std::uint64_t practice = 0, main = 0, excluded = 0, catches = 0, catches_right = 0;
  std::string participant_excluded;  ///< reason by the plan's rule; empty: not excluded
  std::optional<Difference> difference;
  std::optional<Threshold> threshold;
  std::vector<std::string> warnings;
};
/// Error: too few trials are left.
[[nodiscard]] Result<Analysis> analyse(const Plan& plan, const std::vector<Row>& rows);

struct ObservedDocument {
  metrics::DocumentHead head;
  Plan plan;
  ObserverSpec observer;
  std::string device;  ///< empty: none used
  std::vector<Row> rows;
  std::vector<SessionRecord> sessions;  ///< a person's, at the device
  Analysis analysis;
  std::vector<std::string> notes;
};

[[nodiscard]] std::string to_json(const ObservedDocument& document);
/// Trials for the wanted power and the equivalence bound.
[[nodiscard]] Table power_table(const Plan& plan);
/// Results for terminal and page.
[[nodiscard]] std::vector<Table> observed_tables(const ObservedDocument& document);
/// Draws the figures into the folder.
[[nodiscard]] Page observed_page(const ObservedDocument& document, const OutputFolder& folder);
/// The scripts read.R and read.py for trials.csv.
[[nodiscard]] std::string r_snippet(const Plan& plan);
[[nodiscard]] std::string python_snippet(const Plan& plan);

/// Returns the exit status.
[[nodiscard]] Result<int> run_blinded(const BlindedArguments& arguments, Context& context);

}  // namespace palpate::experiments::psychophysics
