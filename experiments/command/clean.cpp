#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "experiments/command/catalogue.h"
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/data/scene_scans.h"
#include "experiments/report/tables.h"
#include "experiments/run/cleaning.h"
#include "experiments/run/output_file.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "toolkit/core/at_stop.h"
#include "toolkit/core/messages.h"
#include "toolkit/io/write_mesh.h"

namespace palpate::experiments {
namespace {

int list_steps(bool json) {
  std::vector<CatalogueEntry> entries;
  for (const scene::CleaningStep& step : all_cleaning().all())
    entries.push_back({step.name, step.summary, step.source, step.options, {}, {}, {}});
  print_catalogue(entries, json);
  if (!json)
    fmt::print(
        "Options follow the step after slashes, steps are joined by +: outliers/distance=3+smooth.\n"
        "Lengths are in spacings: the root of the occupied area per point.\n");
  return kExitOk;
}

void print_json(std::size_t before, std::size_t after, const std::vector<render::PreparePhase>& phases,
                const std::vector<std::string>& notes) {
  nlohmann::ordered_json steps = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < phases.size(); ++i)
    steps.push_back({{"name", phases[i].name}, {"ms", phases[i].ms}, {"note", notes[i]}});
  fmt::print(
      "{}\n",
      nlohmann::ordered_json{{"points_before", before}, {"points_after", after}, {"steps", steps}}.dump(2));
}

struct CleanArguments {
  std::string model;  ///< empty: list the steps
  std::string steps;
  std::string out;
  ModelArguments load;
  bool force = false;  ///< --out may replace what it did not write, or what is read
  bool json = false;
};

void declare_clean(const Declaration& declare, CleanArguments& a) {
  declare.text("MODEL", a.model, kSceneHelp);
  declare.text("--steps", a.steps,
               "STEP[/option=value..] joined by +; without it and a MODEL: the list of steps");
  declare.text("--out", a.out, "the file to write: .ply, or text as .xyz, .txt, .asc, .csv");
  declare.flag("--force", a.force, kForceHelp);
  declare.flag("--json", a.json, "print JSON");
  declare_model(declare, a.load);
}

int run_clean(const CleanArguments& arguments, Context& context) {
  if (arguments.model.empty() && arguments.steps.empty() && arguments.out.empty())
    return list_steps(arguments.json);
  if (arguments.model.empty() || arguments.out.empty())
    return fail({"cleaning needs a model, and --out FILE to write to",
                 "palpate clean scan.ply --steps outliers+smooth --out cleaned.ply",
                 {},
                 0},
                kExitBadInput);
  std::vector<NamedOptions> steps;
  if (!arguments.steps.empty()) {
    Result<std::vector<NamedOptions>> parsed = all_cleaning().parse(arguments.steps);
    if (!parsed) return fail(parsed.error(), kExitBadInput);
    steps = *std::move(parsed);
  }
  const Result<scene::LoadOptions> options = load_options(arguments.load);
  if (!options) return fail(options.error(), kExitBadInput);
  const Result<scene::SceneFile> file = open_scene(arguments.model, all_renderers(), context.progress);
  if (!file) return fail(file.error(), kExitBadInput);
  if (file->models.size() != 1)
    return fail({fmt::format("cleaning takes one model, the scene has {}", file->models.size()),
                 "clean the models one by one", file->path, 0},
                kExitBadInput);
  if (steps.empty() && file->models.front().clean.empty())
    return fail({"there is nothing to do", "give --steps, or [[model.clean]] in the scene", {}, 0},
                kExitBadInput);
  const Status good = check_output({arguments.out, io::cloud_endings(), arguments.force}, files_read(*file));
  if (!good) return fail(good.error(), kExitBadInput);
  AtStop at_stop([&] { return arguments.out + " was not written"; });
  const Result<scene::LoadedScene> loaded = scene::load(*file, all_readers(), *options, context.progress);
  if (!loaded) return fail(loaded.error(), kExitBadInput, &context.progress);
  const cloud::Cloud& before = *loaded->input.models.front().cloud;
  Result<scene::CleanedCloud> cleaned =
      all_cleaning().run(before, steps, arguments.load.threads, context.progress);
  if (!cleaned) return fail(cleaned.error(), kExitBadInput, &context.progress);
  const scene::Provenance& own = loaded->provenance.front();
  cleaned->phases.insert(cleaned->phases.begin(), own.cleaning.begin(), own.cleaning.end());
  cleaned->notes.insert(cleaned->notes.begin(), own.cleaned.begin(), own.cleaned.end());
  if (const Status written = io::write_cloud(arguments.out, cleaned->cloud); !written)
    return fail(written.error(), kExitBadInput, &context.progress);
  at_stop.drop();
  context.progress.clear();
  if (arguments.json) {
    print_json(own.file_points - own.non_finite, cleaned->cloud.size(), cleaned->phases, cleaned->notes);
    return kExitOk;
  }
  for (const std::string& warning : own.warnings) tell("palpate: warning: {}\n", warning);
  for (std::size_t i = 0; i < cleaned->phases.size(); ++i)
    fmt::print("{:>10}  {}\n", duration_text(cleaned->phases[i].ms), cleaned->notes[i]);
  fmt::print("{} points written to {}\n", cleaned->cloud.size(), arguments.out);
  return kExitOk;
}

}  // namespace

Subcommand clean_subcommand() {
  return subcommand(
      "clean", "cleans a raw scan step by step: outliers, smooth, thin, upsample, fill-holes",
      {"palpate clean",
       "palpate clean scan.ply --unit m --steps outliers+smooth/neighbours=12 --out cleaned.ply"},
      declare_clean, run_clean);
}

}  // namespace palpate::experiments
