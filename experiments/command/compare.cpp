#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/live/recording_session.h"
#include "experiments/report/page.h"
#include "experiments/session/terminal.h"
#include "experiments/trade/against.h"
#include "toolkit/core/input_file.h"

namespace palpate::experiments {
namespace {

struct CompareArguments {
  RunArguments run;
  std::string against;  ///< an earlier result.json, or its folder; empty: none
};

void declare_compare(const Declaration& declare, CompareArguments& a) {
  constexpr NumberRange kFrames{0, 10'000'000};  // 2.8 hours at 1 kHz
  constexpr NumberRange kSeconds{0, 86'400};
  RunArguments& run = a.run;
  const Declaration rare = declare.rare();
  declare.required("SCENE", run.scene, kSceneHelp);
  declare_renderers(
      declare, run.renderers,
      "the scene's or the plan's, cloud, and a mesh; auto: the recording's, the scene's or the plan's one");
  declare_path(declare, run.path, "by the model's size");
  declare.text(
      "--against", a.against,
      "an earlier study of the same scene and path, or its result.json: says what became better or worse "
      "beyond the intervals; the exit status is 1 where memory, accuracy or contact became worse");
  declare.integer("--paced", run.paced, kFrames,
                  "also time so many frames at 1 kHz, with the caches warm and evicted");
  rare.integer("--passes", run.passes, kPasses,
               fmt::format("timed passes of each kind and renderer, in turns (default: {})", kUsualPasses));
  rare.number("--timing-budget", run.budget_s, kSeconds,
              fmt::format("seconds of timed passes a renderer: a slow one gets fewer (default: {:g})",
                          kUsualBudgetS));
  rare.text("--save-mesh", run.save_mesh, "write the mesh of a mesh renderer to this PLY file");
  rare.text("--save-edited", run.save_edited,
            "write the first model as the path left it to this file (.ply, .xyz, .txt, .asc, .csv; scenes "
            "with dents)");
  rare.flag("--allow-missing", run.allow_missing,
            "run renderers too that lack what the scene asks for (friction, dents, ..), and say so");
  declare_force(declare, run.force);
  declare_scene_run(declare, run);
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

Result<int> run_compare(const CompareArguments& arguments, Context& context) {
  std::optional<metrics::ResultDocument> before;
  if (!arguments.against.empty()) {
    PALPATE_ASSIGN(before, read_earlier(arguments.against));
  }
  RunArguments run = arguments.run;
  run.one = run.renderers == "auto";
  if (run.one) run.renderers.clear();
  const bool recorded = !run.path.empty() && is_recorded_session(run.path);
  if (recorded && run.one) {
    PALPATE_ASSIGN(run.renderers, renderer_of_recording(run.path));
  }
  int against = kExitOk;
  std::string path;
  const auto finish = [&](const OutputFolder& folder) -> Result<std::string> {
    context.progress.report("drawing the report", -1.0);
    PALPATE_TRY(draw_report(folder));
    std::string text;
    context.progress.clear();
    path = folder.path().string();
    if (before) {
      PALPATE_ASSIGN(text, say_against(*before, folder, against));
    }
    return text + fmt::format("report: {}\n", std::filesystem::absolute(folder.file(kReportFile)).string());
  };
  PALPATE_ASSIGN(const int status, run_study(run, context, finish));
  if (status != kExitOk) return status;
  // What one renderer answers now, beside what it answered when it was recorded.
  if (recorded && !run.renderers.empty() && run.renderers.find(',') == std::string::npos)
    against = std::max(against, check_recording(run, path, context));
  return against;
}

}  // namespace

Subcommand compare_subcommand() {
  return subcommand(
      "compare", "one renderer or several along one probe path: result.json, traces, report.html",
      {"palpate compare scan.ply --unit m",
       "palpate compare sinusoid:points=101761 --renderers cloud-literal,cloud,mesh-godobject --path "
       "weave:frames=20000 --out out/ab",
       "palpate compare scan.ply --unit m --renderers cloud,cloud:refine=1:label=bare --path "
       "exploration:frames=20000 --out out/shading",
       "palpate compare scan.toml --renderers cloud:refine=1 --path probe.csv --out out/probe --paced 5000",
       "palpate compare scan.ply --unit m --friction 0.7,0.5 --path "
       "recorded.txt:t=0:x=1:y=2:z=3:mm_per_unit=1000 --out out/recorded",
       "palpate compare sinusoid:points=101761 --renderers cloud --path weave:frames=20000 --out out/before",
       "palpate compare sinusoid:points=101761 --renderers cloud --path weave:frames=20000 --out out/now "
       "--against out/before"},
      declare_compare, run_compare);
}

}  // namespace palpate::experiments
