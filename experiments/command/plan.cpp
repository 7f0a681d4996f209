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

constexpr const char* kPlanSchema = "palpate-plan-1";

using nlohmann::ordered_json;

ordered_json json(const std::vector<render::Decision>& decisions) {
  ordered_json list = ordered_json::array();
  for (const render::Decision& d : decisions)
    list.push_back({{"about", d.about}, {"choice", d.choice}, {"reason", d.reason}, {"given", d.given}});
  return list;
}

ordered_json or_null(const std::optional<double>& value) {
  return value ? ordered_json(*value) : ordered_json(nullptr);
}

/// Bytes that are not known beforehand are null, as times are.
ordered_json known(std::uint64_t bytes) {
  return bytes > 0 ? ordered_json(bytes) : ordered_json(nullptr);
}

ordered_json json(const plan::Plan& plan) {
  ordered_json models = ordered_json::array();
  for (const render::ModelDecisions& m : plan.decided.models)
    models.push_back({{"name", m.name},
                      {"points", m.points},
                      {"spacing_mm", or_null(m.spacing_mm)},
                      {"bytes", known(m.bytes)},
                      {"prepare_ms", or_null(m.prepare_ms)},
                      {"frame_us", or_null(m.frame_us)},
                      {"decisions", json(m.decisions)}});
  return {{"schema", kPlanSchema},
          {"renderer", plan.renderer.name},
          {"options", plan.renderer.options.all()},
          {"decisions", json(plan.decided.decisions)},
          {"models", models},
          {"bytes", known(plan.decided.bytes)},
          {"expected",
           {{"frame_us", or_null(plan.decided.frame_us)},
            {"prepare_ms", or_null(plan.decided.prepare_ms)},
            {"on", render::kExpectedOn}}}};
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
  context.progress.report("asking the renderer", -1.0);
  const Result<plan::Plan> plan =
      plan::make_plan(loaded->input, wanted, registry, {arguments.load.threads, nullptr});
  context.progress.clear();
  if (!plan) return fail(plan.error(), kExitBadInput);
  std::vector<std::string> warnings = surfaces->warnings;
  for (const scene::Provenance& p : loaded->provenance)
    warnings.insert(warnings.end(), p.warnings.begin(), p.warnings.end());
  for (std::string& doubt : doubts_about_models(*loaded)) warnings.push_back(std::move(doubt));
  for (std::string& text : render::left_out(*registry.find(plan->renderer.name), loaded->input))
    warnings.push_back(std::move(text));
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
