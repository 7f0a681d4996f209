#include "experiments/psychophysics/blinded.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <optional>

#include <palpate/result.h>
#include "experiments/driver/suite.h"
#include "experiments/psychophysics/rig.h"
#include "experiments/psychophysics/trials.h"
#include "experiments/session/session.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments::psychophysics {
namespace {

namespace fs = std::filesystem;

/// The observer's view of a trial. This side knows what A and B are; the observer does not.
Felt felt_in(const Trial& trial, const Plan& plan, const ObserverOptions& observer) {
  double apart = plan.compares() ? observer.dprime : dprime_of_difference(observer, plan.task, trial.level);
  if (plan.compares() && trial.kind == TrialKind::kCatch) apart = observer.catch_dprime;
  Felt felt{plan.task, trial.number, {}};
  for (const char letter : trial.shown) felt.strengths.push_back(letter == 'B' ? apart : 0.0);
  return felt;
}

Status check_observer(const Plan& plan, const ObserverSpec& observer) {
  if (observer.kind != ObserverKind::kSimulated) return Done{};
  if (plan.compares() && observer.has_jnd)
    return Error{"this plan compares two renderers, and a JND is of an option",
                 "say --observer simulated:dprime=1", plan.name};
  if (!plan.compares() && !observer.has_jnd)
    return Error{fmt::format("this plan turns {}, and the observer has no JND", plan.option->key),
                 fmt::format("say --observer simulated:jnd={:g}, in {}", 0.1 * plan.option->standard,
                             plan.option->unit),
                 plan.name};
  return Done{};
}

/// Rejects device options for an observer without a device.
Status check_use(const BlindedArguments& arguments, const ObserverSpec& observer,
                 const DeviceChoice& device) {
  const bool person = observer.kind == ObserverKind::kPerson;
  if (arguments.rate_hz != std::round(arguments.rate_hz))
    return Error{fmt::format("--rate {} is no whole number", arguments.rate_hz), "give whole Hz"};
  if (!person && (arguments.accelerated || arguments.lsl))
    return Error{fmt::format("{} is of a person's session, and nobody is asked",
                             arguments.lsl ? "--lsl" : "--accelerated"),
                 "leave it out, or say --observer person"};
  if (!person && device.is_real())
    return Error{fmt::format("{} needs a hand on it, and the observer has none", shown(device.name())),
                 "say --observer person, or leave --device out"};
  if (person && arguments.accelerated && device.is_real())
    return Error{fmt::format("{} runs in real time, not --accelerated", shown(device.name())),
                 "leave --accelerated out"};
  return Done{};
}

/// Files of the study in the folder: trials.csv is the suite's record, the present session's included once
/// over.
struct Held {
  std::vector<Row> rows{};
  std::uint64_t whole_bytes = csv_head().size();
  std::vector<SessionRecord> sessions{};  ///< a person's
};

/// Begins in a new folder, or goes on in that of the same study's earlier session.
Result<Held> begin_in(Suite& suite, const Plan& plan, const std::string& observer) {
  const RunKey key = RunKey::of_any_program().add("study");
  const OutputFolder& folder = suite.folder();
  const std::string trials = folder.file(kTrialsFile).string(), beside = folder.file(kPlanFile).string();
  Held held;
  std::error_code code;
  if (!fs::exists(trials, code)) {
    PALPATE_TRY(suite.begin(key, kTrialsFile));
    PALPATE_TRY(folder.write(kPlanFile, plan.text));
    PALPATE_TRY(folder.write(kTrialsFile, csv_head()));
    return held;
  }
  PALPATE_ASSIGN(const std::string earlier, read_file(beside, kMostPlanBytes));
  if (earlier != plan.text)
    return Error{"the trials in this folder follow another plan",
                 "take the plan.toml beside them, or give --out a new folder", beside};
  PALPATE_ASSIGN(ReadTrials read, read_trials(trials, plan, observer));
  held.rows = std::move(read.rows);
  held.whole_bytes = read.whole_bytes;
  PALPATE_ASSIGN(held.sessions, read_sessions(folder));
  PALPATE_TRY(suite.begin(key, kTrialsFile));
  return held;
}

/// Everything for rendering forces, made and checked before anything is written. Unused by a simulated
/// observer.
struct Feeling {
  std::unique_ptr<SessionClock> clock;
  std::optional<SessionDevice> device;  ///< a person's
  std::unique_ptr<Markers> markers;     ///< a person's
  std::unique_ptr<Bench> bench;
};

Result<Feeling> feeling_for(const BlindedArguments& arguments, const Plan& plan, const ObserverSpec& observer,
                            const DeviceChoice& device, ProgressBar& progress) {
  Feeling feeling;
  if (observer.kind == ObserverKind::kSimulated) return feeling;
  if (observer.kind == ObserverKind::kPerson) {
    feeling.markers = std::make_unique<Markers>();
    if (arguments.lsl) {
      PALPATE_ASSIGN(feeling.markers,
                     lsl_markers(arguments.lsl_library.empty() ? kLslLibrary : arguments.lsl_library,
                                 "palpate-" + plan.participant));
    }
    feeling.clock = std::make_unique<SessionClock>(arguments.accelerated);
    // The guard is forked, so it comes before threads and a large scene.
    PALPATE_ASSIGN(SessionDevice made,
                   SessionDevice::make(device, feeling.clock->clock(), 1.0 / arguments.rate_hz));
    feeling.device.emplace(std::move(made));
    feeling.device->report_unproven();
  }
  PALPATE_ASSIGN(feeling.bench, Bench::make(plan,
                                            {observer.hand, observer.depth_mm, arguments.rate_hz,
                                             feeling.clock != nullptr && !arguments.accelerated},
                                            progress));
  return feeling;
}

/// Needs of a session that asks questions. Refers to everything.
struct Asking {
  const BlindedArguments& arguments;
  const Plan& plan;
  const ObserverSpec& observer;
  const DeviceChoice& device;
  Feeling& feeling;
  Held& held;
  const Suite& suite;
  std::vector<std::string>& notes;
};

/// Asks an observer that answers at once, until course or session ends. Returns true if the study is
/// complete.
template <class AnswerOf>
Result<bool> ask_each(Asking& asking, Ledger& ledger, AnswerOf&& answer_to) {
  for (;;) {
    PALPATE_ASSIGN(const std::optional<Trial> trial, ledger.next());
    if (!trial) return true;
    if (ledger.session_over()) return false;
    PALPATE_ASSIGN(const Answer answer, answer_to(*trial));
    PALPATE_TRY(ledger.enter(*trial, answer));
    asking.suite.progress().report(fmt::format("trial {}", trial->number), -1.0);
  }
}

Result<bool> ask_simulated(Asking& asking, Ledger& ledger) {
  const Plan& plan = asking.plan;
  const ObserverOptions& options = asking.observer.options;
  return ask_each(asking, ledger, [&](const Trial& trial) -> Result<Answer> {
    return answer_of(options, felt_in(trial, plan, options), answer_seed(plan));
  });
}

void take_warnings(Asking& asking) {
  for (const std::string& warning : asking.feeling.bench->warnings()) asking.notes.push_back(warning);
}

Result<bool> ask_machine(Asking& asking, Ledger& ledger) {
  ProgressBar& progress = asking.suite.progress();
  take_warnings(asking);
  Machine machine(asking.plan, asking.observer, *asking.feeling.bench, asking.device);
  PALPATE_TRY(machine.learn(progress));
  std::string told;
  for (std::size_t c = 0; c < kCues; ++c)
    told += fmt::format("{}{} {:+.2f}", told.empty() ? "" : ", ", kCueNames[c], machine.apart()[c]);
  asking.notes.push_back(
      "The pair of catch and practice trials differs for the machine, in just noticeable "
      "differences: " +
      told + ".");
  return ask_each(asking, ledger, [&](const Trial& trial) -> Result<Answer> {
    FeltTrial felt;
    PALPATE_ASSIGN(const Answer answer, machine.answer(trial, felt, progress));
    PALPATE_TRY(write_trace(asking.suite.folder(), trial.number, felt));
    return answer;
  });
}

Result<bool> ask_at_device(Asking& asking, Ledger& ledger) {
  take_warnings(asking);
  Feeling& feeling = asking.feeling;
  PALPATE_ASSIGN(const PersonSession session,
                 ask_person(asking.plan, *feeling.bench, *feeling.clock, *feeling.device, ledger,
                            asking.suite.folder(), *feeling.markers, asking.suite.progress()));
  if (session.sat) {
    asking.held.sessions.push_back(session.record);
    PALPATE_TRY(write_sessions(asking.suite.folder(), asking.held.sessions));
  }
  return session.complete;
}

/// Asks until course or session ends. Returns true if the study is complete.
Result<bool> ask(Asking& asking) {
  const std::string rows = asking.suite.folder().file(kTrialsFile).string();
  PALPATE_ASSIGN(TrialFile file, TrialFile::append_to(rows, asking.held.whole_bytes));
  Ledger ledger(asking.plan, asking.observer.text, asking.held.rows, std::move(file),
                asking.arguments.stop_after);
  switch (asking.observer.kind) {
    case ObserverKind::kSimulated:
      return ask_simulated(asking, ledger);
    case ObserverKind::kMachine:
      return ask_machine(asking, ledger);
    case ObserverKind::kPerson:
      break;
  }
  return ask_at_device(asking, ledger);
}

Status save_plan(const PlanText& plan, const std::string& file) {
  std::error_code code;
  if (fs::exists(file, code))
    return Error{"there is such a file already", "give --save-plan another name", file};
  PALPATE_TRY(write_file(file, plan.text));
  fmt::print("plan: {}\n", fs::absolute(file).string());
  return Done{};
}

Status finish(const BlindedArguments& arguments, ObservedDocument& document, const Suite& suite) {
  PALPATE_ASSIGN(document.analysis, analyse(document.plan, document.rows));
  const OutputFolder& folder = suite.folder();
  suite.progress().report("drawing the report", -1.0);
  PALPATE_TRY(folder.write("read.R", r_snippet(document.plan)));
  PALPATE_TRY(folder.write("read.py", python_snippet(document.plan)));
  PALPATE_TRY(
      suite.publish({kObservedFile, to_json(document), observed_tables(document), document.analysis.warnings},
                    observed_page(document, folder), arguments.json));
  if (!arguments.json) fmt::print("trials: {}\n", fs::absolute(folder.file(kTrialsFile)).string());
  return Done{};
}

const char* note_on_observer(ObserverKind kind) {
  switch (kind) {
    case ObserverKind::kSimulated:
      return "A simulated observer answered, of known sensitivity: no renderer was run, no device moved, and "
             "no person was asked. This shows what the plan can find, not what people feel.";
    case ObserverKind::kMachine:
      return "A machine answered: a simulated hand felt the renderers on a simulated device, and thresholds "
             "of the literature said what would be noticed. A prediction, to be registered before people are "
             "asked; no person was.";
    case ObserverKind::kPerson:
      break;
  }
  return "A person answered.";
}

Result<Plan> checked_plan(const BlindedArguments& arguments, const PlanText& text) {
  PALPATE_ASSIGN(Plan plan, parse_plan(text.text, text.name, all_renderers()));
  if (arguments.participant.empty()) return plan;
  plan.participant = arguments.participant;
  if (!is_participant_code(plan.participant))
    return Error{"--participant " + shown(plan.participant) + " is no code",
                 "take at most 32 letters, digits, - and _"};
  return plan;
}

Status run_checked(const BlindedArguments& arguments, Plan plan, const ObserverSpec& observer,
                   const DeviceChoice& device, Context& context) {
  PALPATE_ASSIGN(Feeling feeling, feeling_for(arguments, plan, observer, device, context.progress));
  const std::string name = fs::path(plan.name).stem().string();
  Suite suite(context);
  PALPATE_TRY(suite.open(arguments.out.empty() ? "out/study-" + name : arguments.out));
  PALPATE_ASSIGN(Held held, begin_in(suite, plan, observer.text));
  if (!held.rows.empty() && !arguments.json)
    fmt::print("goes on behind {} trials that are answered\n", held.rows.size());
  std::fflush(stdout);
  ObservedDocument document;
  Asking asking{arguments, plan, observer, device, feeling, held, suite, document.notes};
  PALPATE_ASSIGN(const bool complete, ask(asking));
  context.progress.clear();
  if (!complete) {
    fmt::print("{} trials are answered and kept in {}; the same command goes on\n", held.rows.size(),
               suite.folder().file(kTrialsFile).string());
    return suite.folder().complete();
  }
  document.head = new_head(context.command_line);
  document.plan = std::move(plan);
  document.observer = observer;
  document.device = observer.kind == ObserverKind::kSimulated ? "" : device.name();
  document.rows = std::move(held.rows);
  document.sessions = std::move(held.sessions);
  document.notes.insert(document.notes.begin(), note_on_observer(observer.kind));
  return finish(arguments, document, suite);
}

}  // namespace

Result<int> run_blinded(const BlindedArguments& arguments, Context& context) {
  PALPATE_ASSIGN(const PlanText text, read_plan(arguments.plan));
  PALPATE_ASSIGN(Plan plan, checked_plan(arguments, text));
  if (!arguments.save_plan.empty()) {
    PALPATE_TRY(save_plan(text, arguments.save_plan));
    return kExitOk;
  }
  PALPATE_ASSIGN(const ObserverSpec observer, parse_observer(arguments.observer));
  PALPATE_TRY(check_observer(plan, observer));
  PALPATE_ASSIGN(const DeviceChoice device, choose_device(arguments.device, session_drivers()));
  PALPATE_TRY(check_use(arguments, observer, device));
  if (!arguments.json && (arguments.power || context.verbose)) print_tables({power_table(plan)}, true);
  std::fflush(stdout);
  if (!arguments.power) PALPATE_TRY(run_checked(arguments, std::move(plan), observer, device, context));
  return kExitOk;
}

}  // namespace palpate::experiments::psychophysics
