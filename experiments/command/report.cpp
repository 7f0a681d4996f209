// Commands on results: reports, scores, recordings in other formats, the tables of the thesis.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <utility>

#include <palpate/result.h>
#include "experiments/ablate/ablate.h"
#include "experiments/bench/ranking.h"
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/driver/suite.h"
#include "experiments/goals/goals.h"
#include "experiments/live/live.h"
#include "experiments/live/recording_session.h"
#include "experiments/psychophysics/blinded.h"
#include "experiments/report/findings.h"
#include "experiments/report/page.h"
#include "experiments/session/session.h"
#include "experiments/session/version.h"
#include "experiments/stability/stability.h"
#include "experiments/stress/stress.h"
#include "experiments/study/study.h"
#include "experiments/tables/reproduction.h"
#include "experiments/trade/document.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/metrics/scores.h"

namespace palpate::experiments {
namespace {

struct ReportArguments {
  std::string folder;
  std::string docs;  ///< a checkout whose pages are written; empty: none
};

void declare_report(const Declaration& declare, ReportArguments& a) {
  declare.text("DIR", a.folder,
               "a folder that a command wrote as its --out, or a table's folder within that of reproduce");
  declare.text("--docs", a.docs,
               "a checkout of Palpate: writes the figures of its pages from docs/figures; with DIR, first "
               "takes them from what reproduce, stress or felt_surface wrote there");
}

/// The run that the pages show, and what the felt surface writes: one document of its own each, by which its
/// folder is known, and a picture that is shown with it.
constexpr const char* kShownRun = "one-run.json";
struct Shown {
  const char *written, *shown, *picture;
};
constexpr std::array<Shown, 2> kShownTrials = {
    {{"felt_surface.json", "surface.json", nullptr}, {"stress.json", "stress.json", "stress.svg"}}};

Status take_picture(const ReportArguments& arguments, const char* picture) {
  const std::filesystem::path from = std::filesystem::path(arguments.folder) / picture,
                              to = std::filesystem::path(arguments.docs) / "docs/figures" / picture;
  PALPATE_ASSIGN(const std::string text, read_file(from.string(), kMemoryLimitBytes));
  return write_file(to.string(), text);
}

Result<int> write_docs(const ReportArguments& arguments) {
  if (!arguments.folder.empty()) {
    Shown shown{nullptr, kShownRun, nullptr};
    for (const Shown& trial : kShownTrials)
      if (std::filesystem::exists(std::filesystem::path(arguments.folder) / trial.written)) shown = trial;
    PALPATE_TRY(take_page_figures(arguments.docs, shown.shown, arguments.folder));
    if (shown.picture != nullptr) PALPATE_TRY(take_picture(arguments, shown.picture));
  }
  PALPATE_ASSIGN(const std::vector<std::string> written, write_page_figures(arguments.docs));
  for (const std::string& page : written) fmt::print("written: {}\n", page);
  if (written.empty()) fmt::print("every page shows what docs/figures holds\n");
  return kExitOk;
}

// Folders of versions that kept no page.json.

/// Documents that hold all that their pages show.
constexpr std::array<const char*, 3> kDrawnAgain = {kSweepFile, kStressFile, kBenchFile};
/// The others, and what writes them.
constexpr std::array<std::pair<const char*, const char*>, 7> kMadeAgain = {
    {{kAblateFile, "compare ablate"},
     {"behaviours.json", "test behaviours"},
     {kGoalsFile, "test goals"},
     {"hunt.json", "test hunt"},
     {kLiveFile, "live"},
     {kStabilityFile, "test stability"},
     {psychophysics::kObservedFile, "study"}}};

/// Why such a document is not drawn again: which command of which version wrote it, and what draws it.
Error no_kept_page(const std::string& file, const char* kind) {
  std::string version = "an earlier version", command = fmt::format("palpate {}", kind);
  const Result<std::string> text = read_file(file, kMemoryLimitBytes);
  const nlohmann::json document = nlohmann::json::parse(text ? *text : "", nullptr, false);
  const auto take = [&](const char* key, const char* lead, std::string& value) {
    if (!document.is_object() || !document.contains(key) || !document[key].is_string()) return;
    value = lead + document[key].get<std::string>();
  };
  take("version", "palpate ", version);
  take("command", "", command);
  return {fmt::format("was written by `{}` of {}, which kept no page", command, version),
          "run that command again: this version keeps one", file};
}

/// The page of a document that holds all of it.
Result<Page> page_of_document(const std::string& document, const OutputFolder& folder) {
  const std::string file = folder.file(document).string();
  if (document == kSweepFile) {
    PALPATE_ASSIGN(const SweepDocument sweep, read_sweep(folder.path().string()));
    return sweep_page(sweep, folder);
  }
  if (document == kStressFile) {
    PALPATE_ASSIGN(const StressMatrix matrix, read_stress(file));
    return stress_page(matrix);
  }
  PALPATE_ASSIGN(const BenchDocument bench, read_bench(file));
  return bench_page(bench, bench_tables(bench));
}

Status draw_document(const std::string& document, const OutputFolder& folder) {
  PALPATE_ASSIGN(const Page page, page_of_document(document, folder));
  return keep_page(page, folder);
}

Result<int> run_report(const ReportArguments& arguments, Context& context) {
  if (!arguments.docs.empty()) return write_docs(arguments);
  if (arguments.folder.empty())
    return Error{"DIR is required", "name the folder of a study, or a checkout with --docs"};
  const auto file = [&](const char* name) { return std::filesystem::path(arguments.folder) / name; };
  const auto holds = [&](const char* name) { return std::filesystem::exists(file(name)); };
  const bool whole = holds(kReproductionFile), kept = !whole && holds(kPageFile);
  const char* document = nullptr;
  if (!whole && !kept && !holds(kResultFile)) {
    for (const char* one : kDrawnAgain)
      if (document == nullptr && holds(one)) document = one;
    for (const auto& [name, kind] : kMadeAgain)
      if (document == nullptr && holds(name)) return no_kept_page(file(name).string(), kind);
  }
  const bool study = !whole && !kept && document == nullptr;
  // Errors of the folder as a study come before those of it as a place to write.
  if (study) PALPATE_TRY(read_study(arguments.folder));
  PALPATE_ASSIGN(const OutputFolder folder, OutputFolder::reopen(arguments.folder));
  context.progress.report("drawing the report", -1.0);
  const Status drawn = whole   ? draw_reproduction(folder)
                       : kept  ? draw_kept_page(folder)
                       : study ? draw_report(folder)
                               : draw_document(document, folder);
  context.progress.clear();
  context.working = drawn.ok() || study || drawn.error().file.empty();
  PALPATE_TRY(drawn);
  fmt::print("report: {}\n", std::filesystem::absolute(folder.file(kReportFile)).string());
  return kExitOk;
}

/// The scores of every run, and last of all result.json.
Status write_scores(const Study& study, const OutputFolder& folder) {
  for (std::size_t i = 0; i < study.runs.size(); ++i) {
    const std::string& name = study.document.renderers[i].scores_file;
    if (name.empty()) continue;
    const Result<std::string> file = folder.claim(name);
    if (!file) return file.error();
    PALPATE_TRY(metrics::write_scores_csv(study.path, study.runs[i].per_frame, *file));
  }
  return folder.write(kResultFile, metrics::to_json(study.document));
}

/// Scores by another program than that which measured are said to be.
void note_program(metrics::ResultDocument& document) {
  if (document.version == version_text() && document.commit == kCommit) return;
  const std::string note = fmt::format("Scored again by palpate {}, commit {}.", version_text(), kCommit);
  if (std::find(document.notes.begin(), document.notes.end(), note) == document.notes.end())
    document.notes.push_back(note);
}

struct ScoreArguments {
  std::string folder;
  bool json = false;
};

void declare_score(const Declaration& declare, ScoreArguments& a) {
  declare.required("DIR", a.folder, kStudyFolderHelp);
  declare_json(declare, a.json);
  declare.verbose();
}

Result<int> run_score(const ScoreArguments& arguments, Context& context) {
  context.progress.report("reading the study", -1.0);
  PALPATE_ASSIGN(Study study, read_study(arguments.folder));
  PALPATE_ASSIGN(const OutputFolder folder, OutputFolder::reopen(arguments.folder));
  context.progress.report("scoring", -1.0);
  context.working = true;
  PALPATE_TRY(score_study(study));
  note_program(study.document);
  PALPATE_TRY(write_scores(study, folder));
  context.progress.clear();
  if (arguments.json) {
    fmt::print("{}\n", metrics::to_json(study.document));
    return kExitOk;
  }
  print_scores(study.document, context.verbose);
  fmt::print("results: {}\n", folder.path().string());
  if (std::filesystem::exists(folder.file(kReportFile)))
    fmt::print("`palpate report {}` draws the report again\n", arguments.folder);
  tell("{}", findings_text(study.document));
  return kExitOk;
}

void declare_export(const Declaration& declare, ExportArguments& a) {
  declare.required("RECORDING", a.recording, "what `palpate live record` or `palpate live --record` wrote");
  declare.choice("--format", a.format, {"csv", "hdf5", "motion-bids"},
                 "csv: the trace of one renderer, as compare writes it; hdf5: everything; motion-bids: a "
                 "dataset of one subject (default: csv)");
  declare.required("--out", a.out, "the file (.csv, .h5), or the folder of the dataset");
  declare.text("--renderer", a.renderer, "csv: the label of the renderer (default: the first)");
  declare.text("--subject", a.subject, "motion-bids: label of the subject (default: 01)");
  declare.text("--task", a.task, "motion-bids: label of the task (default: touch)");
  declare.flag("--skip-damaged", a.skip_damaged, "leave out damaged parts in the middle, and say so");
  declare_force(declare, a.force);
  declare_json(declare, a.json);
}

void declare_reproduce(const Declaration& declare, ReproduceArguments& a) {
  declare.text("--tables", a.tables,
               "which tables, or manifests of your own (.toml), separated by commas (default: all)");
  declare_required_out(declare, a.out);
  declare.flag("--full", a.full,
               "also the longer runs: every reconstruction and neighbour builder, paced frames, growth to "
               "ten million points, behaviours, protocols; whole models; no time limit for reconstructions");
  declare.rare().number("--mesh-limit", a.mesh_limit_s, kTimesS,
                        "seconds that a reconstruction may take; 0: no limit (default: 120, with --full 0)");
  declare.rare().flag("--no-cache", a.no_cache, "reconstruct every mesh again, and cache none");
  declare.flag("--quick", a.quick, "small models and short paths: a trial run, not a measurement");
  declare.excludes("--quick", "--full");
  declare.cases();
  declare.verbose();
  declare_threads(declare, a.threads);
}

}  // namespace

Subcommand report_subcommand() {
  return subcommand("report", "draws report.html of any command's folder again, from the folder alone",
                    {"palpate report out/ab", "palpate report out/reproduce",
                     "palpate report out/reproduce/table7", "palpate report --docs ."},
                    declare_report, run_report);
}

Subcommand score_subcommand() {
  return subcommand(
      "report score", "scores a study again, from its traces and its ground truth; runs no renderer",
      {"palpate report score out/ab", "palpate report score out/ab --json"}, declare_score, run_score);
}

Subcommand export_subcommand() {
  return subcommand("report export", "a recording as CSV, HDF5 or Motion-BIDS",
                    {"palpate report export session.palrec --out session.csv",
                     "palpate report export session.palrec --format hdf5 --out session.h5",
                     "palpate report export session.palrec --format motion-bids --subject 01 --out dataset"},
                    declare_export, run_export);
}

Subcommand reproduce_subcommand() {
  return subcommand(
      "reproduce", "measures the thesis's tables again, beside the printed values",
      {"palpate reproduce --out out/reproduce", "palpate reproduce --tables 6,7 --out out/tables"},
      declare_reproduce, reproduce);
}

}  // namespace palpate::experiments
