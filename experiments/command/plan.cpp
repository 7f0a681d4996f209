#include "toolkit/plan/plan.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "experiments/command/session.h"
#include "experiments/data/scene_scans.h"
#include "experiments/run/arguments.h"

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

}  // namespace

int run_plan(const PlanArguments& arguments, Context& context) {
  const Result<scene::LoadOptions> options = load_options(arguments.load);
  if (!options) return fail(options.error(), kExitBadInput);
  const Result<scene::SceneFile> file = open_scene(arguments.scene, context.progress);
  if (!file) return fail(file.error(), kExitBadInput);
  std::optional<NamedOptions> wanted = file->renderer;
  const render::Registry registry = all_renderers();
  if (!arguments.renderer.empty()) {
    Result<NamedOptions> named = parse_named_options(arguments.renderer);
    if (!named) return fail(named.error(), kExitBadInput);
    wanted = *std::move(named);
  }
  // A wrong name or option is found here, as replay would find it.
  if (wanted)
    if (const Result<RendererRequest> request = request_of(*wanted, registry); !request)
      return fail(request.error(), kExitBadInput);
  const Result<scene::LoadedScene> loaded = scene::load(*file, all_readers(), *options, context.progress);
  if (!loaded) return fail(loaded.error(), kExitBadInput, &context.progress);
  context.progress.report("measuring the spacing", -1.0);
  const Result<plan::Plan> plan = plan::make_plan(loaded->input, wanted, arguments.load.threads);
  context.progress.clear();
  if (!plan) return fail(plan.error(), kExitBadInput);
  if (arguments.json)
    fmt::print("{}\n", json(*plan).dump(2));
  else
    fmt::print("{}", plan::text(*plan));
  return kExitOk;
}

}  // namespace palpate::experiments
