#include "experiments/stress/stress.h"

#include <fmt/format.h>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"

namespace palpate::experiments {
namespace {

void declare_stress(const Declaration& declare, StressArguments& a) {
  constexpr NumberRange kSeconds{0, 1e7}, kCellSeconds{1, 1e5};
  declare.text("--renderers", a.renderers,
               "A,B,..: each NAME[:option=value...][:label=TEXT] (default: every one)");
  declare.text("--cases", a.cases, "cases or groups of cases, separated by commas (default: all)");
  declare.required("--out", a.out, "folder for the results");
  declare.number("--budget", a.budget_s, kSeconds,
                 "seconds after which no further cell is begun; 0: as long as it takes (default: 0)");
  declare.number(
      "--cell-limit", a.cell_s, kCellSeconds,
      fmt::format("seconds of processor time that one cell may take; then it has failed (default: {:g})",
                  a.cell_s));
  declare.flag("--quick", a.quick, "the short set of cases");
  declare.flag("--full", a.full, "ten million points too");
  declare.excludes("--quick", "--full");
  declare.text(
      "--against", a.against,
      "stress.json of another run (another compiler, processor or number of threads): the trace hashes "
      "must be the same");
  declare.flag("--json", a.json, "print the matrix as JSON");
}

}  // namespace

Subcommand stress_subcommand() {
  return subcommand(
      "stress", "every renderer at the extremes of scale, place, motion and shape: a matrix of what holds",
      {"palpate stress --budget 900 --out out/stress",
       "palpate stress --renderers cloud,cloud-smooth --cases one-point,hip-nan --out out/few",
       "palpate stress --quick --budget 60 --out out/quick",
       "palpate stress --renderers cloud --cases one-point --against out/few/stress.json --out out/here"},
      declare_stress, run_stress);
}

}  // namespace palpate::experiments
