// Lists of names: renderers, paths and cleaning steps.
#include <fmt/format.h>

#include <palpate/paths.h>
#include <palpate/trace.h>
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/run/arguments.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"

namespace palpate::experiments {
namespace {

struct ListArguments {
  std::string name;  ///< empty: all
  bool json = false;
};

void declare_list(const Declaration& declare, ListArguments& a) {
  declare.text("NAME", a.name, "show options, defaults and source of this one (default: a line for each)");
  declare_json(declare, a.json);
}

/// Prints all, or the named one, and what is said below.
Result<int> print_entries(std::vector<CatalogueEntry> entries, const ListArguments& arguments,
                          const char* list, const char* below) {
  PALPATE_TRY(keep_named(entries, arguments.name));
  print_catalogue(entries, arguments.json);
  if (arguments.json) return kExitOk;
  if (arguments.name.empty())
    fmt::print("`palpate list {} NAME` shows options, defaults and source.\n", list);
  fmt::print("{}", below);
  return kExitOk;
}

Result<int> print_renderers(const ListArguments& arguments, Context& /*context*/) {
  const render::Registry registry = all_renderers();
  std::vector<CatalogueEntry> entries;
  for (const render::RendererInfo& info : registry.all())
    entries.push_back({info.name, info.summary, info.source, info.options, std::string(name_of(info.role)),
                       std::string(name_of(info.geometry)), names_of(info.supports)});
  return print_entries(
      std::move(entries), arguments, "renderers",
      "Options follow the name after colons, as in cloud:refine=1; label=TEXT names one used twice;\n"
      "clean=STEP+STEP cleans the points before (`palpate list steps`).\n");
}

Result<int> print_steps(const ListArguments& arguments, Context& /*context*/) {
  std::vector<CatalogueEntry> entries;
  for (const scene::CleaningStep& step : all_cleaning().all())
    entries.push_back({step.name, step.summary, step.source, step.options, {}, {}, {}});
  return print_entries(
      std::move(entries), arguments, "steps",
      "Options follow the step after slashes, steps are joined by +: outliers/distance=3+smooth.\nLengths "
      "are in spacings: the square root of the occupied area per point.\n");
}

CatalogueEntry entry(const std::string& name, const std::string& summary, std::span<const OptionSpec> options,
                     const std::string& models, const std::string& example) {
  CatalogueEntry made{name, summary, {}, options};
  made.models = models;
  made.example = example;
  return made;
}

Result<int> print_paths(const ListArguments& arguments, Context& /*context*/) {
  std::vector<CatalogueEntry> entries;
  for (const paths::PathGenerator& g : paths::path_generators())
    entries.push_back(entry(g.name, g.summary, g.options, g.models, g.example));
  entries.push_back(entry("FILE.csv",
                          fmt::format("a recorded path; its first line is {}", trace::kPathHeader), {}, "any",
                          "probe.csv"));
  entries.push_back(entry("FILE.traj",
                          "a recorded path in columns, separated by blanks, tabs, commas or semicolons; a "
                          "first line of names, and lines that begin with # or %, are skipped",
                          recording_columns(), "any", "probe.traj:t=0:x=1:y=2:z=3:mm_per_unit=1000"));
  return print_entries(std::move(entries), arguments, "paths",
                       "Options follow the name after colons. A recording of any other ending: --path "
                       "probe.txt:t=0:x=1:y=2:z=3.\n"
                       "Lengths are in mm of the model's frame; docs/reference/documents.md says more.\n");
}

}  // namespace

Subcommand renderers_subcommand() {
  return subcommand(
      "list renderers", "the renderers, a line each; with NAME, one's options, defaults and source",
      {"palpate list renderers", "palpate list renderers cloud"}, declare_list, print_renderers);
}

Subcommand paths_subcommand() {
  return subcommand("list paths",
                    "the probe paths that --path takes: generators with their options, and recorded files",
                    {"palpate list paths", "palpate list paths tap",
                     "palpate compare sinusoid:points=10201 --renderers cloud --path "
                     "raster:lines=8:speed_mm_s=100 --out out/raster"},
                    declare_list, print_paths);
}

Subcommand steps_subcommand() {
  return subcommand("list steps",
                    "the steps that clean points, a line each; with NAME, one's options and defaults",
                    {"palpate list steps", "palpate list steps outliers"}, declare_list, print_steps);
}

}  // namespace palpate::experiments
