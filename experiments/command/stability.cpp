#include "experiments/stability/stability.h"

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"

namespace palpate::experiments {
namespace {

void declare_stability(const Declaration& declare, StabilityArguments& a) {
  constexpr NumberRange kJitterMs{0.0, 10.0}, kSlew{0.0, 1e9, true};
  RunArguments& run = a.run;
  declare.required("SCENE", run.scene, kSceneHelp);
  declare.text("--renderers", run.renderers,
               "A,B,..: each NAME[:option=value...][:label=TEXT] (default: the scene's or the plan's, cloud, "
               "and a mesh)");
  declare.text("--device", a.device,
               "the simulated device: omni, touch, falcon, omega3, or admittance (default: omni)");
  declare.text("--hand", a.hand,
               "the simulated hand: hand, finger, arm or released (default: hand); released, a steady push "
               "alone, is measured as well");
  declare.text("--rates", a.rates, "of the servo, Hz (default: 500,1000,2000,4000,8000)");
  declare.text("--delays", a.delays, "from position to force, ms, at 1 kHz (default: 0,1,2,4)");
  declare.text("--dampings", a.dampings,
               "of the wall, N s/mm, at 1 kHz (default: 0,0.0001,0.0002,0.0005,0.001,0.002)");
  declare.flag("--cross", a.cross,
               "every rate with every delay too, without control, behind a passive coupling and under the "
               "passivity controller: minutes a renderer");
  declare.number("--jitter", a.jitter_ms, kJitterMs, "each tick is late by up to so many ms (default: 0)");
  declare.number("--slew", a.slew_n_per_s, kSlew, "limit of the governor, N/s (default: 1000)");
  declare.text("--path", run.path,
               "the goal that the hand steers to: a file or a generator, as `palpate compare` takes it "
               "(default: six seconds, by the model's size)");
  declare_traj_columns(declare, run.traj_columns);
  declare.text("--reference", run.reference,
               "ground truth: auto, analytic, original-mesh, or a mesh file or scan by name in the model's "
               "frame");
  declare_results(declare, run);
  declare_surface(declare, run.surface);
  declare_model(declare, run.load);
}

}  // namespace

Subcommand stability_subcommand() {
  return subcommand(
      "stability", "renderers in a loop with a simulated hand and device: the stiffness that stays stable",
      {"palpate stability sinusoid:points=10201 --out out/stability",
       "palpate stability sinusoid:points=10201 --renderers cloud,cloud-smooth --device falcon --hand finger "
       "--rates 1000,4000 --delays 0,2 --dampings 0,0.001 --out out/falcon",
       "palpate stability sinusoid:points=10201 --renderers cloud --cross --dampings 0 --out out/cross"},
      declare_stability, run_stability);
}

}  // namespace palpate::experiments
