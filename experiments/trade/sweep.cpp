#include "experiments/trade/sweep.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <map>
#include <set>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "experiments/driver/suite.h"
#include "experiments/session/session.h"
#include "experiments/session/version.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

// A preparation may take a minute, and at most what lets a whole turn end in half the remaining time; two
// seconds are always allowed.
constexpr double kMostPrepareS = 60.0, kLeastPrepareS = 2.0, kShareOfTheRest = 0.5;
// Without a budget: reconstructing a million points takes minutes.
constexpr double kFullPrepareS = 600.0;
// Most settings of another precision or rate that a setting waits behind.
constexpr std::size_t kLooksAhead = 64;

/// Version and commit, which distinguish rows of different programs.
std::string program_text() {
  return fmt::format("{} {}", version_text(), kCommit);
}

/// Error: the folder holds the results of a tune, and this is a sweep, or the reverse.
Status check_kind(const OutputFolder& folder, bool tunes) {
  std::error_code code;
  const bool tuned = std::filesystem::exists(folder.file(kTuneFile), code);
  if (tuned == tunes || !std::filesystem::exists(folder.file(kSweepFile), code)) return Done{};
  return Error{fmt::format("the folder holds the results of palpate {}", tuned ? "tune" : "compare sweep"),
               "give --out a new folder, or that of an earlier run of this command", folder.path().string()};
}

bool same_kind(const Setting& a, const Setting& b) {
  return a.precision_bits == b.precision_bits && a.rate_divisor == b.rate_divisor;
}

/// Remaining time of the whole sweep, whatever a step reports.
class SweepProgress final : public Progress {
 public:
  SweepProgress(ProgressBar& bar, std::size_t done, std::size_t all, double spent_s, double budget_s)
      : bar_(bar), spent_s_(spent_s), budget_s_(budget_s) {
    bar_.set_prefix(fmt::format("[{} of {} settings] ", done, all));
    fraction_ = all > 0 ? std::min(1.0, static_cast<double>(done) / static_cast<double>(all)) : 1.0;
    // A log gets a line per turn.
    if (done > 0 && ::isatty(STDERR_FILENO) == 0)
      tell("palpate: {} of {} settings after {}\n", done, all, format_duration(spent_s * kMsPerSecond));
  }
  void report(std::string_view, double) override {
    const double spent_s = spent_s_ + watch_.ms() / kMsPerSecond;
    bar_.report("measuring",
                budget_s_ > 0.0 ? std::min(1.0, std::max(fraction_, spent_s / budget_s_)) : fraction_);
  }

 private:
  static constexpr double kMsPerSecond = 1e3;
  ProgressBar& bar_;
  double spent_s_, budget_s_, fraction_ = 0.0;
  Stopwatch watch_;
};

}  // namespace

Result<std::unique_ptr<Sweep>> Sweep::begin(const SweepArguments& arguments, const render::Registry& registry,
                                            Context& context) {
  std::unique_ptr<Sweep> sweep(new Sweep(context));
  PALPATE_ASSIGN(const std::vector<std::string> turned, parse_axes(arguments.axes));
  PALPATE_ASSIGN(sweep->checked_, check_run(arguments.run, registry, context.progress));
  StageRequest& request = sweep->checked_.stage;
  request.usual_frames = kSweepFrames;
  Suite& suite = sweep->suite_;
  PALPATE_TRY(open_folder(arguments.run, "sweep", request, suite));
  PALPATE_TRY(check_kind(suite.folder(), arguments.tunes));
  const std::string rows = suite.folder().file(kRowsFile).string();
  if (std::error_code code; std::filesystem::exists(rows, code)) {
    PALPATE_ASSIGN(sweep->document_.rows, read_rows(rows));
  }
  for (const std::string& file : suite.files_of_cases(kRowsFile)) {
    PALPATE_ASSIGN(std::vector<Row> more, read_rows(file));
    for (const Row& row : more) sweep->apart_.insert(row.setting);
    sweep->take(std::move(more));
  }
  PALPATE_ASSIGN(sweep->stage_, set_up(request, all_readers(), context.progress));
  PALPATE_ASSIGN(sweep->experiment_, experiment_on(sweep->stage_, program_text()));
  SweepDocument& document = sweep->document_;
  if (std::any_of(document.rows.begin(), document.rows.end(),
                  [&](const Row& row) { return row.experiment != sweep->experiment_->hash; }))
    return Error{"these rows are of another scene, path, truth or version of Palpate",
                 "give --out another folder, or take this one away", rows};
  SettingsRequest settings{sweep->checked_.renderers, turned, arguments.full,
                           sweep->stage_.spacing.resolution_mm};
  if (arguments.tunes)
    std::erase_if(settings.axes,
                  [](const std::string& axis) { return axis == "rate" || axis == "precision"; });
  sweep->settings_ = settings_of(settings, sweep->stage_.scene.input, registry);
  if (sweep->settings_.empty())
    return Error{"no renderer can do what the scene asks for",
                 "`palpate list renderers` says what each supports"};
  sweep->anchor_ = sweep->settings_.front();
  sweep->registry_ = &registry;
  sweep->machine_ = this_machine().hash;
  sweep->measure_.threads = arguments.run.load.threads;
  sweep->measure_.passes = arguments.run.passes;
  document.head = new_head(context.command_line);
  document.scene = sweep->stage_.scene_name;
  document.path = sweep->stage_.path.name;
  document.truth = sweep->stage_.reference->name + ": " + sweep->stage_.reference->exactness;
  document.experiment = sweep->experiment_->hash;
  document.axes = settings.axes;
  document.full = arguments.full;
  document.budget_s = arguments.budget_s >= 0.0 ? arguments.budget_s : arguments.full ? 0.0 : kSweepBudgetS;
  if (suite.partial() || !sweep->apart_.empty()) document.budget_s = 0.0;  // every case is measured
  document.warnings = sweep->stage_.warnings;
  document.notes = sweep->stage_.notes;
  RunKey key = RunKey::of_any_program();
  key.add(document.experiment).add(arguments.run.passes);
  if (arguments.tunes) key.add("tune");
  PALPATE_TRY(suite.begin(key, kRowsFile));
  return sweep;
}

std::set<std::string> Sweep::done(double prepare_limit_s) const {
  std::set<std::string> texts = apart_;
  for (const Row& row : document_.rows)
    // A setting out of time is retried when more time is allowed.
    if (row.machine.hash == machine_ &&
        (row.status != "did-not-finish" || row.prepare_limit_s >= prepare_limit_s))
      texts.insert(row.setting);
  return texts;
}

std::vector<Setting> Sweep::next_turn(double prepare_limit_s) const {
  const std::set<std::string> known = done(prepare_limit_s);
  std::vector<Setting> turn;
  std::size_t looked = 0;
  for (const Setting& setting : settings_) {
    if (turn.size() == kInTurns || (!turn.empty() && ++looked > kLooksAhead)) break;
    if ((turn.empty() || same_kind(setting, turn.front())) && !known.contains(setting.text))
      turn.push_back(setting);
  }
  return turn;
}

void Sweep::take(std::vector<Row> rows) {
  for (Row& row : rows) {
    std::erase_if(document_.rows, [&](const Row& old) {
      return old.setting == row.setting && old.machine.hash == row.machine.hash;
    });
    document_.rows.push_back(std::move(row));
  }
}

std::vector<Setting> Sweep::left_here() const {
  const std::set<std::string> known = done(kFullPrepareS);
  std::size_t points = 0;
  for (const render::ModelInput& model : stage_.scene.input.models) points += model.cloud->size();
  std::vector<Setting> left;
  for (const Setting& setting : settings_) {
    if (known.contains(setting.text)) continue;
    // The anchor is stepped beside it.
    const double frames = 2.0 * static_cast<double>(measure_.passes * stage_.path.size());
    Case one = case_of(setting.request, *registry_->find(setting.request.name), document_.scene, points,
                       frames, static_cast<double>(kPreparations));
    one.name = one.setting = setting.text;
    if (suite_.measures(one)) left.push_back(setting);
  }
  return left;
}

Status Sweep::measure_all() {
  if (suite_.partial()) settings_ = left_here();
  if (settings_.empty()) return Done{};
  const Stopwatch watch;
  const double budget_s = document_.budget_s;
  double longest_s = 0.0;
  for (std::size_t turns = 0;; ++turns) {
    const double spent_s = watch.ms() * 1e-3, left_s = budget_s - spent_s;
    if (budget_s > 0.0 && turns > 0 && left_s < longest_s) break;
    measure_.prepare_limit_s = budget_s > 0.0
                                   ? std::clamp(kShareOfTheRest * left_s / static_cast<double>(kInTurns),
                                                kLeastPrepareS, kMostPrepareS)
                                   : kFullPrepareS;
    const std::vector<Setting> turn = next_turn(measure_.prepare_limit_s);
    if (turn.empty()) break;
    const std::set<std::string> known = done(measure_.prepare_limit_s);
    const auto of_these = std::count_if(settings_.begin(), settings_.end(),
                                        [&](const Setting& one) { return known.contains(one.text); });
    SweepProgress progress(suite_.progress(), static_cast<std::size_t>(of_these), settings_.size(), spent_s,
                           budget_s);
    PALPATE_ASSIGN(std::vector<Row> rows,
                   measure(*experiment_, turn, *anchor_, *registry_, measure_, progress));
    take(std::move(rows));
    PALPATE_TRY(suite_.folder().write(kRowsFile, rows_text(document_.rows)));
    longest_s = std::max(longest_s, watch.ms() * 1e-3 - spent_s);
  }
  const std::set<std::string> known = done(0.0);
  document_.not_measured.clear();
  for (const Setting& setting : settings_)
    if (!known.contains(setting.text)) document_.not_measured.push_back(setting.text);
  suite_.progress().set_prefix("");
  suite_.progress().report("drawing the fronts", -1.0);
  return suite_.folder().write(kRowsFile, rows_text(document_.rows));
}

Status publish_sweep(const SweepDocument& document, const Suite& suite, bool json) {
  const Page page = sweep_page(document, suite.folder());
  suite.progress().clear();
  const auto failed =
      std::count_if(document.rows.begin(), document.rows.end(), [](const Row& r) { return !r.ok(); });
  if (!json)
    tell("palpate: {} settings measured, {} did not run to their end, {} not measured for want of time\n",
         document.rows.size() - static_cast<std::size_t>(failed), failed, document.not_measured.size());
  return suite.publish({kSweepFile, to_json(document), front_tables(document)}, page, json);
}

Result<int> run_sweep(const SweepArguments& arguments, Context& context) {
  const render::Registry registry = all_renderers();
  PALPATE_ASSIGN(const std::unique_ptr<Sweep> sweep, Sweep::begin(arguments, registry, context));
  PALPATE_TRY(sweep->measure_all());
  if (sweep->suite().partial()) return sweep->suite().leave();
  PALPATE_TRY(publish_sweep(sweep->document(), sweep->suite(), arguments.run.json));
  const std::vector<Row>& rows = sweep->document().rows;
  return std::any_of(rows.begin(), rows.end(), [](const Row& r) { return r.ok(); }) ? kExitOk
                                                                                    : kExitFellShort;
}

// Merges rows of several folders: sweeps of one scene, from one or more machines.

namespace {

std::string rows_file(const std::string& folder) {
  return (std::filesystem::path(folder) / kRowsFile).string();
}

/// Adds `other` to `whole`. Identical rows merge; two different rows of one setting and machine are an Error.
Status join(SweepDocument& whole, SweepDocument other, const std::string& folder) {
  if (other.experiment != whole.experiment)
    return Error{
        fmt::format("is of another scene ({}), path, truth or version of Palpate than the first ({})",
                    other.scene, whole.scene),
        "merge folders of one and the same sweep", rows_file(folder)};
  std::map<std::pair<std::string, std::string>, std::string> known;
  for (const Row& row : whole.rows) known[{row.setting, row.machine.hash}] = row_text(row);
  for (Row& row : other.rows) {
    const auto [at, is_new] = known.try_emplace({row.setting, row.machine.hash}, row_text(row));
    if (is_new)
      whole.rows.push_back(std::move(row));
    else if (at->second != row_text(row))
      return Error{fmt::format("'{}' was measured on {} in an earlier folder as well, with another result",
                               row.setting, row.machine.name),
                   "leave one of the folders out", rows_file(folder)};
  }
  for (const auto& [from, to] : {std::pair{&other.not_measured, &whole.not_measured},
                                 {&other.axes, &whole.axes},
                                 {&other.warnings, &whole.warnings},
                                 {&other.notes, &whole.notes}})
    for (std::string& text : *from)
      if (std::find(to->begin(), to->end(), text) == to->end()) to->push_back(std::move(text));
  whole.full = whole.full || other.full;
  return Done{};
}

Result<SweepDocument> merged(const MergeArguments& arguments) {
  PALPATE_ASSIGN(SweepDocument whole, read_sweep(arguments.folders.front()));
  for (std::size_t i = 1; i < arguments.folders.size(); ++i) {
    PALPATE_ASSIGN(SweepDocument other, read_sweep(arguments.folders[i]));
    PALPATE_TRY(join(whole, std::move(other), arguments.folders[i]));
  }
  std::set<std::string> measured;
  for (const Row& row : whole.rows) measured.insert(row.setting);
  std::erase_if(whole.not_measured, [&](const std::string& text) { return measured.contains(text); });
  whole.budget_s = 0.0;
  return whole;
}

Status check_apart(const MergeArguments& arguments) {
  std::error_code code;
  for (const std::string& folder : arguments.folders)
    if (std::filesystem::equivalent(folder, arguments.out, code))
      return Error{"is one of the folders that are merged", "give --out another name", arguments.out};
  return Done{};
}

}  // namespace

Result<int> run_merge(const MergeArguments& arguments, Context& context) {
  PALPATE_TRY(check_apart(arguments));
  PALPATE_ASSIGN(SweepDocument whole, merged(arguments));
  whole.head = new_head(context.command_line);
  Suite suite(context);
  PALPATE_TRY(suite.open(arguments.out));
  PALPATE_TRY(suite.begin(RunKey().add("merge")));
  suite.progress().report("drawing the fronts", -1.0);
  PALPATE_TRY(suite.folder().write(kRowsFile, rows_text(whole.rows)));
  PALPATE_TRY(publish_sweep(whole, suite, arguments.json));
  return kExitOk;
}

}  // namespace palpate::experiments
