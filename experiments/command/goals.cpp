#include "experiments/goals/goals.h"

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"

namespace palpate::experiments {
namespace {

void declare_goals(const Declaration& declare, GoalsArguments& a) {
  declare.text("--out", a.out, "folder for the results; made where it is missing (default: out/goals)");
  declare.flag("--quick", a.quick,
               "small models and short paths, half a minute: a trial of the machinery, no measurement");
  declare.flag("--json", a.json, "print the result as JSON");
  declare_threads(declare, a.threads);
}

}  // namespace

Subcommand goals_subcommand() {
  return subcommand("goals",
                    "the goals of the thesis (section 1.4), each answered by a measurement: a page for each",
                    {"palpate goals --out out/goals", "palpate goals --quick --out out/goals-quick"},
                    declare_goals, run_goals);
}

}  // namespace palpate::experiments
