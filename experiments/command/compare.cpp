#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/ablate/ablate.h"
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/live/recording_session.h"
#include "experiments/report/page.h"
#include "experiments/session/session.h"
#include "experiments/trade/document.h"
#include "experiments/trade/sweep.h"
#include "toolkit/core/files.h"

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
  declare_scene_or_stream(declare, run);
  rare.text(
      "--stream-delay", run.stream_delay,
      "ms from an image's arrival until it is felt, the same for every renderer; or measured: what each "
      "needs (default: 5)");
  declare_renderers(declare, run.renderers,
                    "the scene's or planned one, cloud, and a mesh; auto: only the recording's, the scene's "
                    "or planned one");
  declare_path(declare, run.path, "fitted to the model");
  declare.text(
      "--against", a.against,
      "an earlier study of the same scene and path, or its result.json: says what became better or worse "
      "beyond the confidence intervals; exit status 1 if memory, accuracy or contact became worse");
  declare.integer("--paced", run.paced, kFrames,
                  "also time this many frames at 1 kHz, with warm and with evicted caches");
  rare.integer(
      "--passes", run.passes, kPasses,
      fmt::format("timed passes of each kind per renderer, interleaved (default: {})", kUsualPasses));
  rare.number("--timing-budget", run.budget_s, kSeconds,
              fmt::format("seconds of timed passes per renderer; a slow one gets fewer (default: {:g})",
                          kUsualBudgetS));
  rare.text("--save-mesh", run.save_mesh, "write the mesh of a mesh renderer to this PLY file");
  rare.text("--save-edited", run.save_edited,
            "write the first model as the path left it to this file (.ply, .xyz, .txt, .asc, .csv; scenes "
            "with dents)");
  rare.flag("--allow-missing", run.allow_missing,
            "also run renderers that lack what the scene asks for (friction, dents, ..), and say so");
  declare_force(declare, run.force);
  declare_scene_run(declare, run);
  declare.cases();
}

/// Compares what was just written with the earlier run. The text to print, with `whole` every number;
/// `status` is raised where something became worse.
Result<std::string> describe_against(const metrics::ResultDocument& before, const OutputFolder& folder,
                                     bool whole, int& status) {
  PALPATE_ASSIGN(const metrics::ResultDocument after, read_earlier(folder.path().string()));
  const Result<Changes> changes = changes_between(before, after);
  if (!changes) {
    status = fail(changes.error(), kExitBadInput);
    return std::string();
  }
  PALPATE_TRY(folder.write(kAgainstFile, to_json(*changes, before, after)));
  if (changes->worse_for_sure()) status = kExitFellShort;
  const std::size_t columns = terminal_columns(STDOUT_FILENO);
  if (whole) return to_text(changes_table(*changes), columns) + "\n";
  return joined(wrapped(changes_text(*changes, columns), columns), "\n") + "\n";
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
      PALPATE_ASSIGN(text, describe_against(*before, folder, context.verbose, against));
    }
    return text + fmt::format("report: {}\n", std::filesystem::absolute(folder.file(kReportFile)).string());
  };
  PALPATE_ASSIGN(const int status, run_study(run, context, finish));
  if (status != kExitOk || !context.cases.all()) return status;
  // Compares one renderer's answers now with its recorded ones.
  if (recorded && run.stream.empty() && !run.renderers.empty() &&
      run.renderers.find(',') == std::string::npos)
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
       "palpate compare --stream sim:moving-wall:width=160:height=120 --renderers depth-image,stream-proxy "
       "--path press-and-slide:frames=2000 --out out/stream",
       "palpate compare sinusoid:points=101761 --renderers cloud --path weave:frames=20000 --out out/before",
       "palpate compare sinusoid:points=101761 --renderers cloud --path weave:frames=20000 --out out/now "
       "--against out/before"},
      declare_compare, run_compare);
}

namespace {

// Settings crossed, stages left out, the setting that suits: `palpate compare sweep`, merge, ablate and
// `palpate tune`.

void declare_sweep(const Declaration& declare, SweepArguments& a) {
  declare_trade(declare, a);
  declare.verbose();
  constexpr NumberRange kSeconds{0, 1e7};  // a third of a year
  declare.number(
      "--budget", a.budget_s, kSeconds,
      fmt::format("seconds it may take; 0: no limit (default: {:g}, with --full 0)", kSweepBudgetS));
  declare.flag("--full", a.full, "more values on each axis, and up to three axes varied at once");
}

void declare_merge(const Declaration& declare, MergeArguments& a) {
  declare.several("DIR", a.folders, "folders that `palpate compare sweep` wrote, of one scene and path");
  declare_required_out(declare, a.out);
  declare_json(declare, a.json);
  declare.verbose();
}

void declare_ablate(const Declaration& declare, AblateArguments& a) {
  constexpr NumberRange kSeconds{0, 86'400};
  RunArguments& run = a.run;
  declare.required("SCENE", run.scene, kSceneHelp);
  declare_renderer(declare, run.renderers);
  declare_path(declare, run.path, "six seconds, fitted to the model");
  declare.number("--budget", a.budget_s, kSeconds,
                 fmt::format("seconds that counting instructions may take; 0: no counting (default: {:g})",
                             kCountBudgetS));
  declare.rare().flag("--marked", a.marked,
                      "only step each stage's frames, marked for callgrind: to be run under valgrind");
  declare.cases();
  declare_scene_run(declare, run);
}

void declare_tune(const Declaration& declare, TuneArguments& a) {
  a.sweep.budget_s = kTuneBudgetS;
  constexpr NumberRange kSeconds{1, 1e7}, kLimit{0.0, 1e15, true};
  declare.number(
      "--max-error", a.max_error, kLimit,
      "the cheapest setting whose error (95th percentile, percent of the true force) is at most this");
  declare.number("--max-frame-us", a.max_frame_us, kLimit,
                 "the most accurate setting whose 99.9th percentile of frame times is at most this, µs");
  declare.number("--max-bytes", a.max_bytes, kLimit,
                 "the most accurate setting that takes at most this many bytes in total");
  declare_trade(declare, a.sweep);
  declare.number("--budget", a.sweep.budget_s, kSeconds,
                 fmt::format("seconds that measuring may take (default: {:g})", kTuneBudgetS));
}

}  // namespace

Subcommand sweep_subcommand() {
  return subcommand("compare sweep",
                    "speed, memory and preparation against accuracy: settings combined, Pareto fronts drawn",
                    {"palpate compare sweep sinusoid:points=10201 --budget 60 --out out/sweep",
                     "palpate compare sweep sinusoid:points=10201 --renderers cloud,cloud-smooth --axes "
                     "points,detail --budget 60 "
                     "--out out/detail"},
                    declare_sweep, run_sweep);
}

Subcommand merge_subcommand() {
  return subcommand(
      "compare merge", "joins sweeps of one scene: all their rows, and Pareto fronts for each machine",
      {"palpate compare merge out/sweep-here out/sweep-there --out out/whole",
       "palpate compare sweep sinusoid:points=10201 --renderers cloud --budget 60 --out out/sweep-here",
       "palpate compare sweep sinusoid:points=10201 --renderers cloud-smooth --budget 60 --out "
       "out/sweep-there"},
      declare_merge, run_merge);
}

Subcommand ablate_subcommand() {
  return subcommand(
      "compare ablate", "each stage of a scene left out in turn: what that saves, and what it costs",
      {"palpate compare ablate sinusoid:points=10201 --friction 0.7 --budget 60 --out out/ablate-friction",
       "palpate compare ablate sinusoid:points=10201 --friction 0.7,0.5 --deformation 0.3 --renderer "
       "cloud:refine=1 --out out/ablate"},
      declare_ablate, run_ablate);
}

Subcommand tune_subcommand() {
  return subcommand(
      "tune", "the cheapest setting that is accurate enough, or the most accurate that is cheap enough",
      {"palpate tune sinusoid:points=10201 --max-error 5 --budget 60 --out out/tune",
       "palpate tune sinusoid:points=10201 --max-bytes 4e6 --renderers cloud,cloud-smooth --budget 60 --out "
       "out/small"},
      declare_tune, run_tune);
}

}  // namespace palpate::experiments
