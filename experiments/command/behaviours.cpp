#include "experiments/behaviours/watch.h"
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"

namespace palpate::experiments {
namespace {

void declare_behaviours(const Declaration& declare, BehavioursArguments& a) {
  declare.text("--renderers", a.renderers,
               "A,B,..: each NAME[:option=value...][:label=TEXT] (default: every method)");
  declare.text("--only", a.only, "these behaviours, separated by commas (default: all)");
  declare.required("--out", a.out, "folder for the results");
  declare_threads(declare, a.threads);
  declare.flag("--json", a.json, "print the matrix as JSON");
}

}  // namespace

Subcommand behaviours_subcommand() {
  return subcommand(
      "behaviours",
      "small scenes on which methods differ, each counted: a matrix of renderers and behaviours",
      {"palpate behaviours --out out/behaviours",
       "palpate behaviours --renderers cloud,mesh-godobject --only thin-plate,ridge --out out/two"},
      declare_behaviours, watch_behaviours);
}

}  // namespace palpate::experiments
