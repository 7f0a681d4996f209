#include <fmt/format.h>
#include <unistd.h>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/report/page.h"
#include "experiments/session/terminal.h"
#include "experiments/trade/against.h"
#include "toolkit/core/input_file.h"
#include "toolkit/core/try.h"

namespace palpate::experiments {
namespace {

struct CompareArguments {
  RunArguments run;
  std::string against;  ///< an earlier result.json, or its folder; empty: none
};

void declare_compare(const Declaration& declare, CompareArguments& a) {
  declare.text("--renderers", a.run.renderers,
               "A,B,..: each NAME[:option=value...][:label=TEXT] (default: the scene's or the plan's, "
               "cloud, and a mesh)");
  declare.text(
      "--against", a.against,
      "an earlier study of the same scene and path, or its result.json: says what became better or worse "
      "beyond the intervals; the exit status is 1 where memory, accuracy or contact became worse");
  declare_run(declare, a.run);
}

/// Compares what was just written with the earlier run. The text to print; `status` is raised where something
/// became worse.
Result<std::string> say_against(const metrics::ResultDocument& before, const OutputFolder& folder,
                                int& status) {
  PALPATE_ASSIGN(const metrics::ResultDocument after, read_earlier(folder.path().string()));
  const Result<Changes> changes = changes_between(before, after);
  if (!changes) {
    status = fail(changes.error(), kExitBadInput);
    return std::string();
  }
  PALPATE_TRY(folder.write(kAgainstFile, to_json(*changes, before, after)));
  if (changes->worse_for_sure()) status = kExitFellShort;
  return to_text(changes_table(*changes), terminal_columns(STDOUT_FILENO)) + "\n";
}

int run_compare(const CompareArguments& arguments, Context& context) {
  std::optional<metrics::ResultDocument> before;
  if (!arguments.against.empty()) {
    Result<metrics::ResultDocument> read = read_earlier(arguments.against);
    if (!read) return fail(read.error(), kExitBadInput);
    before = *std::move(read);
  }
  int against = kExitOk;
  const int status = run_study(
      StudyKind::kCompare, arguments.run, context, [&](const OutputFolder& folder) -> Result<std::string> {
        context.progress.report("drawing the report", -1.0);
        PALPATE_TRY(draw_report(folder));
        std::string text;
        context.progress.clear();
        if (before) {
          PALPATE_ASSIGN(text, say_against(*before, folder, against));
        }
        return text +
               fmt::format("report: {}\n", std::filesystem::absolute(folder.file(kReportFile)).string());
      });
  return status != kExitOk ? status : against;
}

}  // namespace

Subcommand compare_subcommand() {
  return subcommand(
      "compare", "several renderers along one path: result.json, traces, report.html",
      {"palpate compare scan.ply --unit m",
       "palpate compare sinusoid:points=101761 --renderers cloud-literal,cloud,mesh-godobject --path "
       "weave:frames=20000 --out out/ab",
       "palpate compare scan.ply --unit m --renderers cloud,cloud:shading=none:label=bare --path "
       "exploration:frames=20000 --out out/shading",
       "palpate compare sinusoid:points=101761 --renderers cloud --path weave:frames=20000 --out out/before",
       "palpate compare sinusoid:points=101761 --renderers cloud --path weave:frames=20000 --out out/now "
       "--against out/before"},
      declare_compare, run_compare);
}

}  // namespace palpate::experiments
