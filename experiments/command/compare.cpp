#include <fmt/format.h>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/report/page.h"
#include "toolkit/core/try.h"

namespace palpate::experiments {
namespace {

void declare_compare(const Declaration& declare, RunArguments& a) {
  declare.text("--renderers", a.renderers,
               "A,B,..: each NAME[:option=value...][:label=TEXT] (default: the scene's or the plan's, "
               "cloud, and a mesh)");
  declare_run(declare, a);
}

int run_compare(const RunArguments& arguments, Context& context) {
  return run_study(
      StudyKind::kCompare, arguments, context, [&](const OutputFolder& folder) -> Result<std::string> {
        context.progress.report("drawing the report", -1.0);
        PALPATE_TRY(draw_report(folder));
        return fmt::format("report: {}\n", std::filesystem::absolute(folder.file(kReportFile)).string());
      });
}

}  // namespace

Subcommand compare_subcommand() {
  return subcommand(
      "compare", "several renderers along one path: result.json, traces, report.html",
      {"palpate compare scan.ply --unit m",
       "palpate compare sinusoid:points=101761 --renderers cloud-literal,cloud,mesh-godobject --path "
       "weave:frames=20000 --out out/ab",
       "palpate compare scan.ply --unit m --renderers cloud,cloud:shading=none:label=bare --path "
       "exploration:frames=20000 --out out/shading"},
      declare_compare, run_compare);
}

}  // namespace palpate::experiments
