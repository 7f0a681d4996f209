#include "experiments/psychophysics/blinded.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>

#include "experiments/session/terminal.h"
#include "toolkit/core/atomic_file.h"
#include "toolkit/core/input_file.h"
#include "toolkit/core/try.h"
#include "toolkit/core/words.h"

namespace palpate::experiments::psychophysics {
namespace {

namespace fs = std::filesystem;

/// What the observer feels of a trial. This side knows what A and B are; the observer's does not.
Felt felt_in(const Trial& trial, const Plan& plan, const ObserverOptions& observer) {
  double apart = plan.compares() ? observer.dprime : dprime_of_difference(observer, plan.task, trial.level);
  if (plan.compares() && trial.kind == TrialKind::kCatch) apart = observer.catch_dprime;
  Felt felt{plan.task, trial.number, {}};
  for (const char letter : trial.shown) felt.strengths.push_back(letter == 'B' ? apart : 0.0);
  return felt;
}

Status check_observer(const Plan& plan, const ObserverSpec& observer) {
  if (plan.compares() && observer.has_jnd)
    return Error{"this plan compares two renderers, and a JND is of an option",
                 "say --observer simulated:dprime=1", plan.name, 0};
  if (!plan.compares() && !observer.has_jnd)
    return Error{fmt::format("this plan turns {}, and the observer has no JND", plan.option->key),
                 fmt::format("say --observer simulated:jnd={:g}, in {}", 0.1 * plan.option->standard,
                             plan.option->unit),
                 plan.name, 0};
  return Done{};
}

struct Opened {
  OutputFolder folder;
  std::vector<Row> rows;
  std::uint64_t whole_bytes = 0;
};

/// A folder that an earlier session of the same study has begun, or a new one.
Result<Opened> open_folder(const std::string& out, const Plan& plan, const std::string& observer) {
  std::error_code code;
  const fs::path root(out);
  if (fs::exists(root / kFolderMark, code)) {
    if (!fs::exists(root / kTrialsFile, code))
      return Error{fmt::format("the folder holds other results, and no {}", kTrialsFile),
                   "give --out a new folder, or that of a session of this study", out, 0};
    PALPATE_ASSIGN(OutputFolder folder, OutputFolder::reopen(out));
    PALPATE_ASSIGN(const std::string earlier, read_file(folder.file(kPlanFile).string(), kMostPlanBytes));
    if (earlier != plan.text)
      return Error{"the trials in this folder follow another plan",
                   "take the plan.toml beside them, or give --out a new folder",
                   folder.file(kPlanFile).string(), 0};
    PALPATE_ASSIGN(ReadTrials read, read_trials(folder.file(kTrialsFile).string(), plan, observer));
    return Opened{std::move(folder), std::move(read.rows), read.whole_bytes};
  }
  PALPATE_ASSIGN(OutputFolder folder, OutputFolder::open(out));
  // Complete from the start: whatever stops a session, its rows stay.
  PALPATE_TRY(folder.begin("study"));
  PALPATE_TRY(folder.write(kPlanFile, plan.text));
  PALPATE_TRY(folder.write(kTrialsFile, csv_head()));
  PALPATE_TRY(folder.complete());
  return Opened{std::move(folder), {}, csv_head().size()};
}

/// Asks until the course ends or the session does. Whether the study is complete.
Result<bool> ask(const BlindedArguments& arguments, const Plan& plan, const ObserverSpec& observer,
                 Opened& opened, Context& context) {
  Course course(plan);
  for (const Row& row : opened.rows) course.answered(row);
  PALPATE_ASSIGN(TrialFile file,
                 TrialFile::append_to(opened.folder.file(kTrialsFile).string(), opened.whole_bytes));
  const std::uint64_t seed = answer_seed(plan);
  long long asked = 0;
  while (const std::optional<Trial> trial = course.next()) {
    if (arguments.stop_after > 0 && asked == arguments.stop_after) return false;
    if (trial->number > 2 * kMostTrials)
      return Error{"answers are excluded again and again, and the study does not end",
                   "look at the column 'excluded' of trials.csv", opened.folder.file(kTrialsFile).string(),
                   0};
    Row row;
    row.trial = *trial;
    row.answer = answer_of(observer.options, felt_in(*trial, plan, observer.options), seed);
    row.excluded = exclusion_of(row.answer, plan.exclusions);
    PALPATE_TRY(file.write(csv_row(row, plan, observer.text)));
    course.answered(row);
    opened.rows.push_back(std::move(row));
    ++asked;
    context.progress.report("trials", -1.0);
  }
  return true;
}

void print_table(const Table& table) {
  fmt::print("{}\n", to_text(table, terminal_columns(STDOUT_FILENO)));
  std::fflush(stdout);
}

int save_plan(const PlanText& plan, const std::string& file) {
  std::error_code code;
  if (fs::exists(file, code))
    return fail({"there is such a file already", "give --save-plan another name", file, 0}, kExitBadInput);
  if (const Status written = write_file(file, plan.text); !written)
    return fail(written.error(), kExitBadInput);
  fmt::print("plan: {}\n", fs::absolute(file).string());
  return kExitOk;
}

int finish(const BlindedArguments& arguments, ObservedDocument& document, const OutputFolder& folder,
           Context& context) {
  Result<Analysis> analysis = analyse(document.plan, document.rows);
  if (!analysis) return fail(analysis.error(), kExitFellShort, &context.progress);
  document.analysis = *std::move(analysis);
  context.progress.report("drawing the report", -1.0);
  const Status written = write_observed(document, folder);
  context.progress.clear();
  if (!written) return fail(written.error(), kExitFellShort);
  if (arguments.json) {
    fmt::print("{}", to_json(document));
    return kExitOk;
  }
  for (const Table& table : observed_tables(document)) print_table(table);
  for (const std::string& warning : document.analysis.warnings)
    fmt::print(stderr, "palpate: warning: {}\n", warning);
  fmt::print("trials: {}\nreport: {}\n", fs::absolute(folder.file(kTrialsFile)).string(),
             fs::absolute(folder.file(kReportFile)).string());
  return kExitOk;
}

}  // namespace

int run_blinded(const BlindedArguments& arguments, Context& context) {
  const Result<PlanText> text = read_plan(arguments.plan);
  if (!text) return fail(text.error(), kExitBadInput);
  Result<Plan> plan = parse_plan(text->text, text->name, all_renderers());
  if (!plan) return fail(plan.error(), kExitBadInput);
  if (!arguments.save_plan.empty()) return save_plan(*text, arguments.save_plan);
  if (!arguments.participant.empty()) {
    plan->participant = arguments.participant;
    if (!is_participant_code(plan->participant))
      return fail({"--participant " + shown(plan->participant) + " is no code",
                   "take at most 32 letters, digits, - and _",
                   {},
                   0},
                  kExitBadInput);
  }
  const Result<ObserverSpec> observer = parse_observer(arguments.observer);
  if (!observer) return fail(observer.error(), kExitBadInput);
  if (const Status fits = check_observer(*plan, *observer); !fits) return fail(fits.error(), kExitBadInput);
  if (!arguments.json) print_table(power_table(*plan));
  if (arguments.power) return kExitOk;
  const std::string name = fs::path(text->name).stem().string();
  Result<Opened> opened =
      open_folder(arguments.out.empty() ? "out/study-" + name : arguments.out, *plan, observer->text);
  if (!opened) return fail(opened.error(), kExitBadInput);
  if (!opened->rows.empty() && !arguments.json)
    fmt::print("goes on behind {} trials that are answered\n", opened->rows.size());
  const Result<bool> complete = ask(arguments, *plan, *observer, *opened, context);
  if (!complete) return fail(complete.error(), kExitFellShort, &context.progress);
  if (!*complete) {
    context.progress.clear();
    fmt::print("{} trials are answered and kept in {}; the same command goes on\n", opened->rows.size(),
               opened->folder.file(kTrialsFile).string());
    return kExitOk;
  }
  ObservedDocument document;
  document.head = new_head(context.command_line);
  document.plan = *std::move(plan);
  document.observer = *observer;
  document.rows = std::move(opened->rows);
  document.notes.emplace_back(
      "A simulated observer answered, of known sensitivity: no renderer was run, no device moved, and no "
      "person was "
      "asked. This shows what the plan can find, not what people feel.");
  return finish(arguments, document, opened->folder, context);
}

}  // namespace palpate::experiments::psychophysics
