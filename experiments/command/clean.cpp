#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/data/scans.h"
#include "experiments/report/tables.h"
#include "experiments/run/arguments.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

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
  std::string model, steps, out;
  ModelArguments load;
  bool force = false;  ///< --out may replace what it did not write, or what is read
  bool json = false;
};

void declare_clean(const Declaration& declare, CleanArguments& a) {
  declare.required("MODEL", a.model, kSceneHelp);
  declare.text("--steps", a.steps,
               "STEP[/option=value..] joined by +, of `palpate list steps` (default: those of the scene)");
  declare.required("--out", a.out, "the file to write: .ply, or text as .xyz, .txt, .asc, .csv");
  declare_force(declare, a.force);
  declare_json(declare, a.json);
  declare_model(declare, a.load);
}

Result<int> run_clean(const CleanArguments& arguments, Context& context) {
  std::vector<NamedOptions> steps;
  if (!arguments.steps.empty()) {
    PALPATE_ASSIGN(steps, all_cleaning().parse(arguments.steps));
  }
  PALPATE_ASSIGN(const scene::LoadOptions options, load_options(arguments.load));
  PALPATE_ASSIGN(const scene::SceneFile file, open_scene(arguments.model, all_renderers(), context.progress));
  if (file.models.size() != 1)
    return Error{fmt::format("cleaning takes one model, the scene has {}", file.models.size()),
                 "clean the models one by one", file.path};
  if (steps.empty() && file.models.front().clean.empty())
    return Error{"there is nothing to do", "give --steps, or [[model.clean]] in the scene"};
  PALPATE_TRY(check_output({arguments.out, io::cloud_extensions(), arguments.force}, files_read(file)));
  StopCallback stop_callback([&] { return arguments.out + " was not written"; });
  PALPATE_ASSIGN(const scene::LoadedScene loaded,
                 scene::load(file, all_readers(), options, context.progress));
  const cloud::Cloud& before = *loaded.input.models.front().cloud;
  PALPATE_ASSIGN(scene::CleanedCloud cleaned,
                 all_cleaning().run(before, steps, arguments.load.threads, context.progress));
  const scene::Provenance& own = loaded.provenance.front();
  cleaned.phases.insert(cleaned.phases.begin(), own.cleaning.begin(), own.cleaning.end());
  cleaned.notes.insert(cleaned.notes.begin(), own.cleaned.begin(), own.cleaned.end());
  PALPATE_TRY(io::write_cloud(arguments.out, cleaned.cloud));
  stop_callback.drop();
  context.progress.clear();
  if (arguments.json) {
    print_json(own.file_points - own.non_finite - own.outside, cleaned.cloud.size(), cleaned.phases,
               cleaned.notes);
    return kExitOk;
  }
  for (const std::string& warning : own.warnings) tell("palpate: warning: {}\n", warning);
  for (std::size_t i = 0; i < cleaned.phases.size(); ++i)
    fmt::print("{:>10}  {}\n", format_duration(cleaned.phases[i].ms), cleaned.notes[i]);
  fmt::print("{} points written to {}\n", cleaned.cloud.size(), arguments.out);
  return kExitOk;
}

}  // namespace

Subcommand clean_subcommand() {
  return subcommand(
      "clean", "cleans a raw scan step by step: outliers, smooth, thin, upsample, fill-holes",
      {"palpate clean scan.ply --unit m --steps thin --out thin.ply",
       "palpate clean scan.ply --unit m --steps outliers+smooth/neighbours=12 --out cleaned.ply"},
      declare_clean, run_clean);
}

}  // namespace palpate::experiments
