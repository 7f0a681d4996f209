#include <fmt/format.h>

#include <array>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/report/page.h"
#include "experiments/report/page_figures.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/core/atomic_file.h"
#include "toolkit/core/input_file.h"
#include "toolkit/core/try.h"

namespace palpate::experiments {

namespace {

struct ReportArguments {
  std::string folder;
  std::string docs;  ///< a checkout whose pages are written; empty: none
};

void declare_report(const Declaration& declare, ReportArguments& a) {
  declare.text("DIR", a.folder, kStudyFolderHelp);
  declare.text("--docs", a.docs,
               "a checkout of Palpate: writes the figures of its pages from docs/figures, and with DIR takes "
               "them from what reproduce, stress or felt_surface wrote there first");
}

/// The run that the pages show, and what the felt surface writes: one document of its own each, by which its
/// folder is known, and a picture that is shown with it.
constexpr const char* kShownRun = "one-run.json";
struct Shown {
  const char *written, *shown, *picture;
};
constexpr std::array<Shown, 2> kTrials = {
    {{"felt_surface.json", "surface.json", nullptr}, {"stress.json", "stress.json", "stress.svg"}}};

Status take_picture(const ReportArguments& arguments, const char* picture) {
  const std::filesystem::path from = std::filesystem::path(arguments.folder) / picture,
                              to = std::filesystem::path(arguments.docs) / "docs/figures" / picture;
  PALPATE_ASSIGN(const std::string text, read_file(from.string(), kMemoryLimitBytes));
  return write_file(to.string(), text);
}

int write_docs(const ReportArguments& arguments) {
  if (!arguments.folder.empty()) {
    Shown shown{nullptr, kShownRun, nullptr};
    for (const Shown& trial : kTrials)
      if (std::filesystem::exists(std::filesystem::path(arguments.folder) / trial.written)) shown = trial;
    Status taken = take_page_figures(arguments.docs, shown.shown, arguments.folder);
    if (taken && shown.picture != nullptr) taken = take_picture(arguments, shown.picture);
    if (!taken) return fail(taken.error(), kExitBadInput);
  }
  const Result<std::vector<std::string>> written = write_page_figures(arguments.docs);
  if (!written) return fail(written.error(), kExitBadInput);
  for (const std::string& page : *written) fmt::print("written: {}\n", page);
  if (written->empty()) fmt::print("every page shows what docs/figures holds\n");
  return kExitOk;
}

int run_report(const ReportArguments& arguments, Context& context) {
  if (!arguments.docs.empty()) return write_docs(arguments);
  if (arguments.folder.empty())
    return fail({"DIR is required", "name the folder of a study, or a checkout with --docs", {}, 0},
                kExitBadInput);
  const bool whole = std::filesystem::exists(std::filesystem::path(arguments.folder) / kReproductionFile);
  // What is wrong with the folder as a study is said before what is wrong with it as a place to write.
  if (!whole)
    if (const Result<Study> study = read_study(arguments.folder); !study)
      return fail(study.error(), kExitBadInput, &context.progress);
  const Result<OutputFolder> folder = OutputFolder::reopen(arguments.folder);
  if (!folder) return fail(folder.error(), kExitBadInput, &context.progress);
  context.progress.report("drawing the report", -1.0);
  const Status drawn = whole ? draw_reproduction(*folder) : draw_report(*folder);
  context.progress.clear();
  if (!drawn)
    return fail(drawn.error(), whole && !drawn.error().file.empty() ? kExitBadInput : kExitFellShort);
  fmt::print("report: {}\n", std::filesystem::absolute(folder->file(kReportFile)).string());
  return kExitOk;
}

}  // namespace

Subcommand report_subcommand() {
  return subcommand(
      "report", "draws report.html of a study, or of all that reproduce wrote, again, from the folder alone",
      {"palpate report out/ab", "palpate report out/reproduce", "palpate report out/reproduce/table7",
       "palpate report --docs ."},
      declare_report, run_report);
}

}  // namespace palpate::experiments
