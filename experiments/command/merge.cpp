#include "experiments/command/subcommands.h"
#include "experiments/trade/sweep.h"

namespace palpate::experiments {
namespace {

void declare_merge(const Declaration& declare, MergeArguments& a) {
  declare.several("DIR", a.folders, "folders that `palpate sweep` wrote, of one scene and path");
  declare.required("--out", a.out, "folder for the whole; made where it is missing");
  declare.flag("--json", a.json, "print the result as JSON");
}

}  // namespace

Subcommand merge_subcommand() {
  return subcommand("merge", "shards of a sweep in one: rows joined, fronts drawn, for each machine its own",
                    {"palpate sweep sinusoid:points=10201 --budget 60 --shard 1/2 --out out/shard-1",
                     "palpate sweep sinusoid:points=10201 --budget 60 --shard 2/2 --out out/shard-2",
                     "palpate merge out/shard-1 out/shard-2 --out out/whole"},
                    declare_merge, run_merge);
}

}  // namespace palpate::experiments
