#include "toolkit/plan/plan.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/data/scene_scans.h"
#include "experiments/run/arguments.h"
#include "experiments/run/cleaning.h"
#include "experiments/run/doubts.h"
#include "experiments/session/session.h"

namespace palpate::experiments {
namespace {

nlohmann::ordered_json json(const std::vector<plan::Decision>& decisions) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const plan::Decision& d : decisions)
    list.push_back({{"about", d.about}, {"choice", d.choice}, {"reason", d.reason}, {"given", d.given}});
  return list;
}

nlohmann::ordered_json json(const plan::Plan& plan) {
  nlohmann::ordered_json models = nlohmann::ordered_json::array();
  for (const plan::ModelPlan& m : plan.models)
    models.push_back({{"name", m.name},
                      {"points", m.points},
                      {"spacing_mm", m.spacing_mm},
                      {"bytes", m.bytes},
                      {"decisions", json(m.decisions)}});
  return {{"renderer", plan.renderer.name},
          {"decisions", json(plan.decisions)},
          {"models", models},
          {"bytes", plan.bytes},
          {"expected",
           {{"frame_us", plan.frame_us}, {"prepare_ms", plan.prepare_ms}, {"on", plan::kPlanHardware}}}};
}

struct PlanArguments {
  std::string scene;
  std::string renderer;  ///< empty: the scene's, or the plan's own choice
  ModelArguments load;
  SurfaceArguments surface;
  bool json = false;
};

void declare_plan(const Declaration& declare, PlanArguments& a) {
  declare.required("SCENE", a.scene, kSceneHelp);
  declare.text("--renderer", a.renderer, "NAME[:option=value...]; default: the scene's, or the plan's own");
  declare.flag("--json", a.json, "print JSON");
  declare_surface(declare, a.surface);
  declare_model(declare, a.load);
}

int run_plan(const PlanArguments& arguments, Context& context) {
  const Result<scene::LoadOptions> options = load_options(arguments.load);
  if (!options) return fail(options.error(), kExitBadInput);
  const render::Registry registry = all_renderers();
  Result<scene::SceneFile> file = open_scene(arguments.scene, registry, context.progress);
  if (!file) return fail(file.error(), kExitBadInput);
  const Result<SurfaceReport> surfaces = set_surfaces(arguments.surface, *file);
  if (!surfaces) return fail(surfaces.error(), kExitBadInput);
  std::optional<NamedOptions> wanted = file->renderer;
  if (!arguments.renderer.empty()) {
    Result<NamedOptions> named = parse_named_options(arguments.renderer);
    if (!named) return fail(named.error(), kExitBadInput);
    wanted = *std::move(named);
  }
  // A wrong name or option is found here, as replay would find it; so is the cleaning that it asks for.
  std::vector<NamedOptions> clean;
  if (wanted) {
    Result<RendererRequest> request = request_of(*wanted, registry);
    if (!request) return fail(request.error(), kExitBadInput);
    wanted = NamedOptions{request->name, std::move(request->options)};
    clean = std::move(request->clean);
  }
  Result<scene::LoadedScene> loaded = scene::load(*file, all_readers(), *options, context.progress);
  if (!loaded) return fail(loaded.error(), kExitBadInput, &context.progress);
  if (const Status felt = check_surfaces(*loaded); !felt)
    return fail(felt.error(), kExitBadInput, &context.progress);
  if (!clean.empty()) {
    Result<CleanedScene> cleaned =
        clean_scene(loaded->input, clean, arguments.load.threads, context.progress);
    if (!cleaned) return fail(cleaned.error(), kExitBadInput, &context.progress);
    loaded->input = std::move(cleaned->input);
  }
  context.progress.report("measuring the spacing", -1.0);
  const Result<plan::Plan> plan = plan::make_plan(loaded->input, wanted, arguments.load.threads);
  context.progress.clear();
  if (!plan) return fail(plan.error(), kExitBadInput);
  std::vector<std::string> warnings = surfaces->warnings;
  for (const scene::Provenance& p : loaded->provenance)
    warnings.insert(warnings.end(), p.warnings.begin(), p.warnings.end());
  for (std::string& doubt : doubts_about_models(*loaded)) warnings.push_back(std::move(doubt));
  if (arguments.json) {
    nlohmann::ordered_json document = json(*plan);
    document["warnings"] = warnings;
    document["notes"] = surfaces->notes;
    fmt::print("{}\n", document.dump(2));
    return kExitOk;
  }
  fmt::print("{}", plan::text(*plan));
  for (const std::string& warning : warnings) fmt::print(stderr, "palpate: warning: {}\n", warning);
  for (const std::string& note : surfaces->notes) fmt::print(stderr, "palpate: note: {}\n", note);
  return kExitOk;
}

}  // namespace

Subcommand plan_subcommand() {
  return subcommand("plan",
                    "what will be built for a scene and why, with bytes and expected cost; nothing is run",
                    {"palpate plan sinusoid:points=101761", "palpate plan scan.toml --renderer cloud --json"},
                    declare_plan, run_plan);
}

}  // namespace palpate::experiments
