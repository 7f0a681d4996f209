#include "experiments/ablate/ablate.h"

#include <fmt/format.h>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"

namespace palpate::experiments {
namespace {

void declare_ablate(const Declaration& declare, AblateArguments& a) {
  constexpr NumberRange kSeconds{0, 86'400};
  RunArguments& run = a.run;
  declare.required("SCENE", run.scene, kSceneHelp);
  declare.text("--renderer", run.renderers,
               "NAME[:option=value...]; default: the scene's, or the plan's choice");
  declare.text(
      "--path", run.path,
      "a file or a generator, as `palpate compare` takes it (default: six seconds, by the model's size)");
  declare_traj_columns(declare, run.traj_columns);
  declare.text("--reference", run.reference,
               "ground truth: auto, analytic, original-mesh, none, or a mesh file or scan by name in the "
               "model's frame");
  declare.number("--budget", a.budget_s, kSeconds,
                 fmt::format("seconds that counting instructions may take; 0: count none (default: {:g})",
                             kCountBudgetS));
  declare.flag("--marked", a.marked,
               "only step each stage's frames between callgrind's marks: what is run under valgrind");
  declare_results(declare, run);
  declare_surface(declare, run.surface);
  declare_model(declare, run.load);
}

}  // namespace

Subcommand ablate_subcommand() {
  return subcommand(
      "ablate", "each stage of a scene left out in turn: what that saves, and what it costs",
      {"palpate ablate sinusoid:points=10201 --friction 0.7 --budget 60 --out out/ablate-friction",
       "palpate ablate sinusoid:points=10201 --friction 0.7,0.5 --deformation 0.3 --renderer "
       "cloud:refine=1 --out out/ablate"},
      declare_ablate, run_ablate);
}

}  // namespace palpate::experiments
