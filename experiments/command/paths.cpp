#include <fmt/format.h>

#include "experiments/command/catalogue.h"
#include "experiments/command/subcommands.h"
#include "experiments/run/arguments.h"
#include "toolkit/trace/paths.h"
#include "toolkit/trace/trace_io.h"

namespace palpate::experiments {

namespace {

CatalogueEntry entry(const std::string& name, const std::string& summary, std::span<const OptionSpec> options,
                     const std::string& models, const std::string& example) {
  CatalogueEntry made{name, summary, {}, options};
  made.models = models;
  made.example = example;
  return made;
}

struct PathsArguments {
  std::string name;  ///< empty: all
  bool json = false;
};

void declare_paths(const Declaration& declare, PathsArguments& a) {
  declare.text("NAME", a.name, "show this one alone (default: all)");
  declare.flag("--json", a.json, "print JSON");
}

int run_paths(const PathsArguments& arguments, Context& /*context*/) {
  std::vector<CatalogueEntry> entries;
  for (const trace::PathGenerator& g : trace::path_generators())
    entries.push_back(entry(g.name, g.summary, g.options, g.models, g.example));
  entries.push_back(entry("FILE.csv", fmt::format("a recorded path, its first line {}", trace::kPathHeader),
                          {}, "any", "probe.csv"));
  entries.push_back(
      entry("FILE.traj",
            "a recording in columns between blanks, tabs, commas or semicolons; lines that begin with # "
            "or %, and a first line of names, are skipped",
            recording_columns(), "any", "probe.traj:t=0:x=1:y=2:z=3:mm_per_unit=1000"));
  if (const Status found = keep_named(entries, arguments.name); !found)
    return fail(found.error(), kExitBadInput);
  print_catalogue(entries, arguments.json);
  if (!arguments.json)
    fmt::print(
        "Options follow the name after colons. A recording of any other ending: --path probe.txt "
        "--traj-columns\n"
        "t=0,x=1,y=2,z=3. Lengths are in mm of the model's frame; docs/paths.md says more.\n");
  return kExitOk;
}

}  // namespace

Subcommand paths_subcommand() {
  return subcommand("paths",
                    "the probe paths that --path takes: generators with their options, and recorded files",
                    {"palpate paths", "palpate paths tap",
                     "palpate replay sinusoid:points=10201 --renderer cloud --path "
                     "raster:lines=8:speed_mm_s=100 --out out/raster"},
                    declare_paths, run_paths);
}

}  // namespace palpate::experiments
