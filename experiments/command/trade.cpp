// Settings crossed, stages left out, the setting that suits: `palpate compare sweep`, merge, ablate and
// `palpate tune`.
#include <fmt/format.h>

#include "experiments/ablate/ablate.h"
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/trade/sweep.h"
#include "experiments/trade/tune.h"

namespace palpate::experiments {
namespace {

void declare_sweep(const Declaration& declare, SweepArguments& a) {
  declare_trade(declare, a);
  declare.verbose();
  constexpr NumberRange kSeconds{0, 1e7};  // a third of a year
  declare.number("--budget", a.budget_s, kSeconds,
                 fmt::format("seconds it may take; 0: as long as it takes (default: {:g}, with --full 0)",
                             kSweepBudgetS));
  declare.flag("--full", a.full, "more values on each axis, and up to three of them turned at once");
  declare.text(
      "--shard", a.shard,
      "the part of the settings that is measured here, such as 2/8; `palpate compare merge` joins them");
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
  declare_path(declare, run.path, "six seconds, by the model's size");
  declare.number("--budget", a.budget_s, kSeconds,
                 fmt::format("seconds that counting instructions may take; 0: count none (default: {:g})",
                             kCountBudgetS));
  declare.rare().flag("--marked", a.marked,
                      "only step each stage's frames between callgrind's marks: what is run under valgrind");
  declare_scene_run(declare, run);
}

void declare_tune(const Declaration& declare, TuneArguments& a) {
  a.sweep.budget_s = kTuneBudgetS;
  constexpr NumberRange kSeconds{1, 1e7}, kLimit{0.0, 1e15, true};
  declare.number(
      "--max-error", a.max_error, kLimit,
      "the cheapest setting whose error (95th percentile, percent of the true force) is at most this");
  declare.number("--max-frame-us", a.max_frame_us, kLimit,
                 "the most accurate setting of which 99.9 % of all frames take at most so many µs");
  declare.number("--max-bytes", a.max_bytes, kLimit,
                 "the most accurate setting that holds at most so many bytes, all told");
  declare_trade(declare, a.sweep);
  declare.number("--budget", a.sweep.budget_s, kSeconds,
                 fmt::format("seconds that measuring may take (default: {:g})", kTuneBudgetS));
}

}  // namespace

Subcommand sweep_subcommand() {
  return subcommand("compare sweep",
                    "the trade of speed, memory and preparation for accuracy: settings crossed, fronts drawn",
                    {"palpate compare sweep sinusoid:points=10201 --budget 60 --out out/sweep",
                     "palpate compare sweep sinusoid:points=10201 --renderers cloud,cloud-smooth --axes "
                     "points,detail --budget 60 "
                     "--out out/detail"},
                    declare_sweep, run_sweep);
}

Subcommand merge_subcommand() {
  return subcommand("compare merge",
                    "shards of a sweep in one: rows joined, fronts drawn, for each machine its own",
                    {"palpate compare merge out/shard-1 out/shard-2 --out out/whole",
                     "palpate compare sweep sinusoid:points=10201 --budget 60 --shard 1/2 --out out/shard-1",
                     "palpate compare sweep sinusoid:points=10201 --budget 60 --shard 2/2 --out out/shard-2"},
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
