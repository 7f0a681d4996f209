// The whole of `palpate study`: a plan, an observer, a folder with trials.csv, study.json and report.html.
#pragma once

#include <string>
#include <vector>

#include "experiments/live/session_device.h"
#include "experiments/psychophysics/analysis.h"
#include "experiments/psychophysics/sessions.h"
#include "experiments/report/page.h"
#include "experiments/session/session.h"

namespace palpate::experiments::psychophysics {

inline constexpr const char* kObservedFile = "study.json";
/// Goes up when a key changes its meaning or goes away.
inline constexpr const char* kObservedSchema = "palpate-observed/1";
inline constexpr const char* kPlanFile = "plan.toml";

struct BlindedArguments {
  std::string plan;  ///< a file, or an example by its name
  std::string observer = "simulated:dprime=1";
  std::string out;           ///< empty: out/study-NAME
  std::string participant;   ///< empty: the plan's
  std::string save_plan;     ///< writes the plan to this file, and runs nothing
  long long stop_after = 0;  ///< trials of this session; 0: all
  DeviceArguments device;    ///< of a machine and a person
  double rate_hz = 1000.0;   ///< of the servo, whole
  bool accelerated = false;  ///< a person's session on a simulated device, in virtual time
  bool lsl = false;          ///< marks of a person's session to Lab Streaming Layer
  std::string lsl_library;   ///< empty: kLslLibrary
  bool power = false;        ///< prints what is decided beforehand, and runs nothing
  bool json = false;
};

struct ObservedDocument {
  metrics::DocumentHead head;
  Plan plan;
  ObserverSpec observer;
  std::string device;  ///< empty: none was used
  std::vector<Row> rows;
  std::vector<SessionRecord> sessions;  ///< at the device, of a person
  Analysis analysis;
  std::vector<std::string> notes;
};

[[nodiscard]] std::string to_json(const ObservedDocument& document);
/// What is printed before the first trial: trials for the wanted power, and the equivalence bound.
[[nodiscard]] Table power_table(const Plan& plan);
/// What was found, for the terminal and the page.
[[nodiscard]] std::vector<Table> observed_tables(const ObservedDocument& document);
/// study.json, report.html with its figures, and read.R and read.py, which read trials.csv.
[[nodiscard]] Status write_observed(const ObservedDocument& document, const OutputFolder& folder);
/// The scripts.
[[nodiscard]] std::string r_snippet(const Plan& plan);
[[nodiscard]] std::string python_snippet(const Plan& plan);

/// The exit status.
int run_blinded(const BlindedArguments& arguments, Context& context);

}  // namespace palpate::experiments::psychophysics
