#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/psychophysics/blinded.h"

namespace palpate::experiments {
namespace {

void declare_study(const Declaration& declare, psychophysics::BlindedArguments& a) {
  constexpr NumberRange kTrials{1, psychophysics::kMostTrials};
  declare.required(
      "PLAN", a.plan,
      "a plan (.toml), or an example by its name: abx, same-different, constant, staircase, psi");
  declare.text("--observer", a.observer,
               "who answers: simulated:dprime=1, or simulated:jnd=0.05 where an option is turned; further "
               "options: strategy, slope, lapse, bias, criterion, catch_dprime, missed (default: "
               "simulated:dprime=1)");
  declare.text("--participant", a.participant,
               "code of the participant, a folder each (default: the plan's)");
  declare.integer("--stop-after", a.stop_after, kTrials,
                  "end this session after so many trials; the same command goes on from there");
  declare.flag("--power", a.power, "print trials for the wanted power and the equivalence bound, and stop");
  declare.text("--save-plan", a.save_plan, "write the plan to this new file, to be changed, and stop");
  declare.text("--out", a.out, "folder for the results (default: out/study-NAME)");
  declare.flag("--json", a.json, "print study.json instead of tables");
}

}  // namespace

Subcommand study_subcommand() {
  return subcommand(
      "study",
      "a blinded study by a plan: ABX, same-different, forced choice, staircases; with a simulated "
      "observer",
      {"palpate study abx --observer simulated:dprime=2 --out out/abx",
       "palpate study staircase --observer simulated:jnd=0.05 --out out/staircase",
       "palpate study abx --power"},
      declare_study, psychophysics::run_blinded);
}

}  // namespace palpate::experiments
