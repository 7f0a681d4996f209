#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/tables/reproduction.h"
#include "toolkit/core/physical_ranges.h"

namespace palpate::experiments {
namespace {

void declare_reproduce(const Declaration& declare, ReproduceArguments& a) {
  declare.text("--tables", a.tables,
               "which tables, or manifests of your own (.toml), separated by commas (default: all)");
  declare.required("--out", a.out, "folder for the results");
  declare.flag("--full", a.full,
               "longer runs too: growth with the number of points to ten million; whole models; no "
               "limit of time for reconstructions");
  declare.number("--mesh-limit", a.mesh_limit_s, kTimesS,
                 "a reconstruction may take so many seconds; 0: no limit (default: 120, with --full 0)");
  declare.flag("--no-cache", a.no_cache, "make every mesh anew, and keep none for the next run");
  declare.flag("--quick", a.quick, "small models, short paths: tries the machinery, measures nothing");
  declare.excludes("--quick", "--full");
  declare_threads(declare, a.threads);
}

}  // namespace

Subcommand reproduce_subcommand() {
  return subcommand(
      "reproduce", "the thesis's tables beside the printed values, and a comparison",
      {"palpate reproduce --out out/reproduce", "palpate reproduce --tables 6,7 --out out/tables"},
      declare_reproduce, reproduce);
}

}  // namespace palpate::experiments
