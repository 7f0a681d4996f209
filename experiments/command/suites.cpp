// The kinds of `palpate test`.
#include <fmt/format.h>

#include "experiments/behaviours/behaviour.h"
#include "experiments/bench/ranking.h"
#include "experiments/command/cli.h"
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/goals/goals.h"
#include "experiments/hunt/hunt.h"
#include "experiments/stability/stability.h"
#include "experiments/stress/stress.h"

namespace palpate::experiments {
namespace {

void declare_behaviours(const Declaration& declare, BehavioursArguments& a) {
  declare_renderers(declare, a.renderers, "every method");
  declare.text("--only", a.only, "these behaviours, separated by commas (default: all)");
  declare_required_out(declare, a.out);
  declare_threads(declare, a.threads);
  declare_json(declare, a.json);
  declare.verbose();
  declare.cases();
}

void declare_stress(const Declaration& declare, StressArguments& a) {
  constexpr NumberRange kSeconds{0, 1e7}, kCellSeconds{1, 1e5};
  declare_renderers(declare, a.renderers, "every renderer");
  declare.text("--cases", a.cases, "cases or groups of cases, separated by commas (default: all)");
  declare_required_out(declare, a.out);
  declare.number("--budget", a.budget_s, kSeconds,
                 "seconds after which no further cell begins; 0: no limit (default: 0)");
  declare.rare().number(
      "--cell-limit", a.cell_s, kCellSeconds,
      fmt::format("seconds of processor time after which a cell has failed (default: {:g})", a.cell_s));
  declare.flag("--quick", a.quick, "the short set of cases");
  declare.flag("--full", a.full, "also with ten million points");
  declare.excludes("--quick", "--full");
  declare.text(
      "--against", a.against,
      "stress.json of another run (another compiler, processor or number of threads): the trace hashes "
      "must be the same");
  declare_json(declare, a.json);
  declare.verbose();
  declare.cases();
}

void declare_hunt(const Declaration& declare, HuntArguments& a) {
  constexpr NumberRange kMinutes{0.0, 10'080.0, true};  // a week
  constexpr NumberRange kTrials{1, 1'000'000'000}, kSeeds{0, 1'000'000'000};
  declare_renderers(declare, a.renderers, "all of ours; options given here are kept");
  declare.number("--minutes", a.minutes, kMinutes,
                 "how long, including a resumed hunt's earlier part (default: 10)");
  declare.integer("--trials", a.trials, kTrials, "this many trials instead, however long they take");
  declare.flag("--as-given", a.as_given, "do not vary the renderers' options");
  declare.integer("--seed", a.seed, kSeeds, "seed of the random search (default: 1)");
  declare_required_out(declare, a.out);
  declare_json(declare, a.json);
  declare.verbose();
  declare.cases();
  declare.excludes("--minutes", "--trials");
}

void declare_stability(const Declaration& declare, StabilityArguments& a) {
  constexpr NumberRange kJitterMs{0.0, 10.0}, kSlew{0.0, 1e9, true};
  RunArguments& run = a.run;
  declare.required("SCENE", run.scene, kSceneHelp);
  declare_renderers(declare, run.renderers, "the scene's or planned one, cloud, and a mesh");
  declare.text("--device", a.device,
               "the simulated device: omni, touch, falcon, omega3, or admittance (default: omni)");
  declare.text("--grip", a.hand,
               "the simulated hand: hand, finger, arm or released (default: hand); released, a steady push "
               "alone, is measured as well");
  declare.text("--rates", a.rates, "servo rates, Hz (default: 500,1000,2000,4000,8000)");
  declare.text("--delays", a.delays, "delays from position to force, ms, at 1 kHz (default: 0,1,2,4)");
  declare.text("--dampings", a.dampings,
               "damping of the wall, N s/mm, at 1 kHz (default: 0,0.0001,0.0002,0.0005,0.001,0.002)");
  declare.flag("--cross", a.cross,
               "also every rate with every delay, without control, with a passive coupling and with the "
               "passivity controller: minutes per renderer");
  declare.rare().number("--jitter", a.jitter_ms, kJitterMs,
                        "each tick is late by up to this many ms (default: 0)");
  declare.rare().number("--slew", a.slew_n_per_s, kSlew,
                        "the governor's slew rate limit, N/s (default: 1000)");
  declare_path(declare, run.path, "six seconds, fitted to the model");
  declare_scene_run(declare, run);
  declare.cases();
}

void declare_goals(const Declaration& declare, GoalsArguments& a) {
  declare.text("--out", a.out, "folder for the results (default: out/goals)");
  declare.flag("--quick", a.quick,
               "small models and short paths, half a minute: a trial run, not a measurement");
  declare_json(declare, a.json);
  declare.verbose();
  declare.cases();
  declare_threads(declare, a.threads);
}

void declare_bench(const Declaration& declare, BenchArguments& a) {
  declare.text("--entry", a.entries,
               fmt::format("renderers (plug-ins too) and folders of recorded traces, separated by commas "
                           "(default: {})",
                           kUsualEntries));
  declare.text("--seed", a.seed,
               "seed of the cases: public, nominal, or a secret text of 16 characters or more, which gives "
               "hidden ones and is written nowhere (default: public)");
  declare.text("--out", a.out, "folder for the results (default: out/bench)");
  declare.text("--save-cases", a.save_cases,
               "folder for the points and path of every case, to be answered by traces; nothing is run");
  declare.text("--check", a.check, "bench.json whose cases and answers are made again and compared");
  declare.text("--against", a.against,
               "bench.json of another seed: the difference shows what is tuned to one of them");
  declare.flag("--quick", a.quick,
               "few points and frames, less than a minute: a trial run, not a measurement");
  declare_threads(declare, a.threads);
  declare_json(declare, a.json);
  declare.verbose();
  declare.cases();
  declare.excludes("--save-cases", "--out");
  for (const char* other : {"--check", kEmitOption, kEngineOption}) declare.excludes("--save-cases", other);
  declare.excludes("--check", "--against");
  declare.excludes("--check", "--quick");
}

}  // namespace

Subcommand behaviours_subcommand() {
  return subcommand(
      "test behaviours",
      "small scenes on which methods differ, each counted: a matrix of renderers and behaviours",
      {"palpate test behaviours --out out/behaviours",
       "palpate test behaviours --renderers cloud,mesh-godobject --only thin-plate,ridge --out out/two"},
      declare_behaviours, watch_behaviours);
}

Subcommand stress_subcommand() {
  return subcommand(
      "test stress",
      "every renderer at the extremes of scale, place, motion and shape: a matrix of what holds",
      {"palpate test stress --budget 900 --out out/stress",
       "palpate test stress --renderers cloud,cloud-smooth --cases one-point,hip-nan --out out/few",
       "palpate test stress --quick --budget 60 --out out/quick",
       "palpate test stress --renderers cloud --cases one-point --against out/few/stress.json --out "
       "out/here"},
      declare_stress, run_stress);
}

Subcommand hunt_subcommand() {
  return subcommand(
      "test hunt",
      "random search for the worst a renderer does: longest frame, largest force, contact that "
      "sticks, jumps, energy, hands that are caught, lost or kicked",
      {"palpate test hunt --out out/hunt",
       "palpate test hunt --renderers cloud,heightfield --trials 40 --as-given --seed 7 --out out/hunt-two"},
      declare_hunt, hunt);
}

Subcommand stability_subcommand() {
  return subcommand(
      "test stability",
      "renderers in a loop with a simulated hand and device: the stiffness that stays stable",
      {"palpate test stability sinusoid:points=10201 --out out/stability",
       "palpate test stability sinusoid:points=10201 --renderers cloud,cloud-smooth --device falcon --grip "
       "finger --rates 1000,4000 --delays 0,2 --dampings 0,0.001 --out out/falcon",
       "palpate test stability sinusoid:points=10201 --renderers cloud --cross --dampings 0 --out out/cross"},
      declare_stability, run_stability);
}

Subcommand goals_subcommand() {
  return subcommand(
      "test goals", "the goals of the thesis (section 1.4), each answered by a measurement: a page for each",
      {"palpate test goals --out out/goals", "palpate test goals --quick --out out/goals-quick"},
      declare_goals, run_goals);
}

Subcommand bench_subcommand() {
  return subcommand(
      "test bench",
      "Palpate Bench: renderers, plug-ins and recorded traces on public or hidden cases, ranked",
      {"palpate test bench --out out/bench",
       "palpate test bench --entry cloud,cloud-smooth --quick --out out/bench-quick",
       "palpate test bench --quick --save-cases out/bench-cases",
       "palpate test bench --check out/bench-quick/bench.json --entry cloud --out out/bench-check"},
      declare_bench, run_bench);
}

}  // namespace palpate::experiments
