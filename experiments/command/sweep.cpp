#include "experiments/trade/sweep.h"

#include <fmt/format.h>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"

namespace palpate::experiments {
namespace {

void declare_sweep(const Declaration& declare, SweepArguments& a) {
  declare_trade(declare, a);
  constexpr NumberRange kSeconds{0, 1e7};  // a third of a year
  declare.number("--budget", a.budget_s, kSeconds,
                 fmt::format("seconds it may take; 0: as long as it takes (default: {:g}, with --full 0)",
                             kSweepBudgetS));
  declare.flag("--full", a.full, "more values on each axis, and up to three of them turned at once");
  declare.text("--shard", a.shard,
               "the part of the settings that is measured here, such as 2/8; `palpate merge` joins them");
}

}  // namespace

Subcommand sweep_subcommand() {
  return subcommand(
      "sweep", "the trade of speed, memory and preparation for accuracy: settings crossed, fronts drawn",
      {"palpate sweep sinusoid:points=10201 --budget 60 --out out/sweep",
       "palpate sweep sinusoid:points=10201 --renderers cloud,cloud-smooth --axes points,detail --budget 60 "
       "--out out/detail"},
      declare_sweep, run_sweep);
}

}  // namespace palpate::experiments
