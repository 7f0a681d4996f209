#include <fmt/format.h>

#include "experiments/command/commands.h"
#include "experiments/command/study_run.h"
#include "experiments/report/page.h"

namespace palpate::experiments {

int run_compare(const RunArguments& arguments, Context& context) {
  return run_study(
      StudyKind::kCompare, arguments, context, [&](const OutputFolder& folder) -> Result<std::string> {
        context.progress.report("drawing the report", -1.0);
        if (const Status drawn = draw_report(folder); !drawn) return drawn.error();
        return fmt::format("report: {}\n", std::filesystem::absolute(folder.file(kReportFile)).string());
      });
}

}  // namespace palpate::experiments
