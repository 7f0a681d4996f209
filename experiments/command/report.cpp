#include <fmt/format.h>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/report/page.h"

namespace palpate::experiments {

namespace {

struct ReportArguments {
  std::string folder;
};

void declare_report(const Declaration& declare, ReportArguments& a) {
  declare.required("DIR", a.folder, kStudyFolderHelp);
}

int run_report(const ReportArguments& arguments, Context& context) {
  // What is wrong with the folder as a study is said before what is wrong with it as a place to write.
  if (const Result<Study> study = read_study(arguments.folder); !study)
    return fail(study.error(), kExitBadInput, &context.progress);
  const Result<OutputFolder> folder = OutputFolder::reopen(arguments.folder);
  if (!folder) return fail(folder.error(), kExitBadInput, &context.progress);
  context.progress.report("drawing the report", -1.0);
  const Status drawn = draw_report(*folder);
  context.progress.clear();
  if (!drawn) return fail(drawn.error(), kExitFellShort);
  fmt::print("report: {}\n", std::filesystem::absolute(folder->file(kReportFile)).string());
  return kExitOk;
}

}  // namespace

Subcommand report_subcommand() {
  return subcommand("report", "draws report.html of a study again, from the files in its folder alone",
                    {"palpate report out/ab", "palpate report out/reproduce/table7"}, declare_report,
                    run_report);
}

}  // namespace palpate::experiments
