#include <fmt/format.h>

#include "experiments/command/catalogue.h"
#include "experiments/command/commands.h"
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

}  // namespace

int run_paths(const PathsArguments& arguments) {
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

}  // namespace palpate::experiments
