#include <fmt/format.h>

#include "experiments/command/commands.h"
#include "experiments/command/study_run.h"
#include "experiments/report/page.h"

namespace palpate::experiments {

int run_compare(const RunArguments& arguments, Context& context) {
  return run_study(
      arguments, context, [&](const Study& study, const OutputFolder& folder) -> Result<std::string> {
        context.progress.report("drawing the report", -1.0);
        Page page = begin_page("Comparison of haptic renderers", study.document);
        add_study(page, study, "study", folder);
        if (const Status written = write_page(page, folder); !written) return written.error();
        return fmt::format("report: {}\n", std::filesystem::absolute(folder.file("report.html")).string());
      });
}

}  // namespace palpate::experiments
