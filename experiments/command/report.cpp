#include <fmt/format.h>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/report/page.h"
#include "experiments/tables/reproduction.h"

namespace palpate::experiments {

namespace {

struct ReportArguments {
  std::string folder;
};

void declare_report(const Declaration& declare, ReportArguments& a) {
  declare.required("DIR", a.folder, kStudyFolderHelp);
}

int run_report(const ReportArguments& arguments, Context& context) {
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
      {"palpate report out/ab", "palpate report out/reproduce", "palpate report out/reproduce/table7"},
      declare_report, run_report);
}

}  // namespace palpate::experiments
