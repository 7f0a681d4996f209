#include <fmt/format.h>

#include "experiments/command/commands.h"
#include "experiments/report/page.h"

namespace palpate::experiments {

int run_report(const StudyArguments& arguments, Context& context) {
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

}  // namespace palpate::experiments
