#include "experiments/hunt/hunt.h"

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"

namespace palpate::experiments {
namespace {

void declare_hunt(const Declaration& declare, HuntArguments& a) {
  constexpr NumberRange kMinutes{0.0, 10'080.0, true};  // a week
  constexpr NumberRange kTrials{1, 1'000'000'000}, kSeeds{0, 1'000'000'000};
  declare.text("--renderers", a.renderers,
               "A,B,..: each NAME[:option=value...]; options that are given stay "
               "(default: all of ours)");
  declare.number("--minutes", a.minutes, kMinutes,
                 "how long, with what an interrupted hunt took before (default: 10)");
  declare.integer("--trials", a.trials, kTrials, "so many trials instead, whatever time they take");
  declare.flag("--as-given", a.as_given, "turn no options of renderers");
  declare.integer("--seed", a.seed, kSeeds, "of the random search (default: 1)");
  declare.required("--out", a.out,
                   "folder for what is found; a hunt that was interrupted in it is gone on with");
  declare.flag("--json", a.json, "print what was found as JSON");
  declare.excludes("--minutes", "--trials");
}

}  // namespace

Subcommand hunt_subcommand() {
  return subcommand(
      "hunt",
      "random search for the worst a renderer does: longest frame, largest force, contact that "
      "sticks, jumps, energy, hands that are caught, lost or kicked",
      {"palpate hunt --out out/hunt",
       "palpate hunt --renderers cloud,heightfield --trials 40 --as-given --seed 7 --out out/hunt-two"},
      declare_hunt, hunt);
}

}  // namespace palpate::experiments
