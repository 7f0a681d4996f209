#include "toolkit/plan/plan.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include <palpate/result.h>
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/data/scans.h"
#include "experiments/run/arguments.h"
#include "experiments/run/run.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "experiments/session/version.h"
#include "toolkit/core/messages.h"

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
            {"on", plan.machine ? plan::text(*plan.machine) : render::kReferenceMachine},
            {"why", plan.cost ? plan.cost->reason : "as measured there, for points of no special kind"}}}};
}

struct PlanArguments {
  std::string scene;
  std::string renderer;  ///< empty: the scene's, or the plan's own choice
  ModelArguments load;
  SurfaceArguments surface;
  std::string machine = "auto";
  bool check = false;
  bool json = false;
};

void declare_plan(const Declaration& declare, PlanArguments& a) {
  declare.required("SCENE", a.scene, kSceneHelp);
  declare_renderer(declare, a.renderer);
  declare.rare().choice("--machine", a.machine, {"auto", "anew", "off"},
                        "machine of the expected frame times: auto, this one, measured in a second and "
                        "cached; anew, this one, measured again; off, the reference machine");
  declare.flag("--check", a.check, "also prepare and run it, and show measured beside expected values");
  declare_json(declare, a.json);
  declare_surface(declare, a.surface);
  declare_model(declare, a.load);
}

/// Expected values beside the measured ones.
struct Checked {
  plan::SceneRun flight;
  std::uint64_t bytes_expected = 0;
  std::optional<double> frame_us_expected;
};

double off_percent(double expected, double measured) {
  constexpr double kPercent = 100.0;
  return measured > 0.0 ? kPercent * (expected / measured - 1.0) : 0.0;
}

ordered_json json(const std::optional<Checked>& checked) {
  if (!checked) return nullptr;
  const auto off = [](const std::optional<double>& expected, double measured) {
    return expected ? ordered_json(off_percent(*expected, measured)) : ordered_json(nullptr);
  };
  const auto bytes = static_cast<double>(checked->bytes_expected);
  return {
      {"bytes", checked->flight.bytes},
      {"bytes_off_percent", off(bytes > 0.0 ? std::optional(bytes) : std::nullopt, checked->flight.bytes)},
      {"frame_us", checked->flight.contact_us},
      {"frame_off_percent", off(checked->frame_us_expected, checked->flight.contact_us)}};
}

std::string text(const Checked& checked) {
  const auto beside = [](const std::optional<double>& expected, double measured) {
    return expected ? fmt::format("{:+.0f} % expected", off_percent(*expected, measured))
                    : std::string("nothing was expected");
  };
  const auto bytes = static_cast<double>(checked.bytes_expected);
  return fmt::format("measured: {} beside the points ({}), {} µs a frame in contact ({})\n",
                     format_bytes(checked.flight.bytes),
                     beside(bytes > 0.0 ? std::optional(bytes) : std::nullopt, checked.flight.bytes),
                     format_number(checked.flight.contact_us),
                     beside(checked.frame_us_expected, checked.flight.contact_us));
}

/// The way that `compare` takes where none is named: expected and measured along it.
std::string path_over(const render::ModelInput& model) {
  paths::PathTarget target;
  target.surface = model.analytic.get();
  target.cloud = model.cloud.get();
  target.box_mm = model.cloud->box_mm();
  return usual_path(target, kUsualFrames);
}

/// As compare would step it.
Result<Checked> check(const plan::Plan& plan, const render::SceneInput& scene, int threads,
                      const render::Registry& registry) {
  PALPATE_ASSIGN(const plan::SceneRun flight,
                 plan::run_scene(scene, plan.renderer, registry, path_over(scene.models.front()), threads));
  if (!(flight.contact_frames > 0.0))
    return Error{"nothing is felt along the path", "check the file and its unit, or take another renderer"};
  return Checked{flight, plan.decided.bytes, plan.decided.frame_us};
}

/// Time of a frame here: of renderers on points and heights, whose cut-outs are prepared in no time.
void expect_here(const PlanArguments& arguments, const render::SceneInput& scene,
                 const render::Registry& registry, Context& context, plan::Plan& plan) {
  const render::Role role = registry.find(plan.renderer.name)->role;
  if (arguments.machine == "off" || (role != render::Role::kOurs && role != render::Role::kLiteral)) return;
  plan::Machine machine =
      plan::measure_machine(version_text(), arguments.machine == "anew", &context.progress);
  context.progress.report("stepping pieces of it", -1.0);
  const std::string path = path_over(scene.models.front());
  plan::estimate_on_machine(plan, scene, registry, path, std::move(machine));
}

/// Scene and path of the arguments, loaded.
struct PlannedScene {
  scene::LoadedScene loaded;
  std::optional<NamedOptions> wanted;  ///< the renderer that is named, or none
  SurfaceReport surfaces;
};

/// Every Error is bad input.
Result<PlannedScene> load_planned(const PlanArguments& arguments, const render::Registry& registry,
                                  Progress& progress) {
  PALPATE_ASSIGN(const scene::LoadOptions options, load_options(arguments.load));
  PALPATE_ASSIGN(scene::SceneFile file, open_scene(arguments.scene, registry, progress));
  PlannedScene planned;
  PALPATE_ASSIGN(planned.surfaces, set_surfaces(arguments.surface, file));
  planned.wanted = file.renderer;
  if (!arguments.renderer.empty()) {
    PALPATE_ASSIGN(planned.wanted, parse_named_options(arguments.renderer));
  }
  // A wrong name or option is found here, as compare would find it; so is the cleaning that it asks for.
  std::vector<NamedOptions> clean;
  if (planned.wanted) {
    PALPATE_ASSIGN(RendererRequest request, request_of(*planned.wanted, registry));
    planned.wanted = NamedOptions{request.name, std::move(request.options)};
    clean = std::move(request.clean);
  }
  PALPATE_ASSIGN(planned.loaded, scene::load(file, all_readers(), options, progress));
  PALPATE_TRY(check_surfaces(planned.loaded));
  if (clean.empty()) return planned;
  PALPATE_ASSIGN(CleanedScene cleaned,
                 clean_scene(planned.loaded.input, clean, arguments.load.threads, progress));
  planned.loaded.input = std::move(cleaned.input);
  return planned;
}

std::vector<std::string> warnings_of(const PlannedScene& planned, const plan::Plan& plan,
                                     const render::Registry& registry) {
  std::vector<std::string> warnings = planned.surfaces.warnings;
  warnings.insert(warnings.end(), plan.warnings.begin(), plan.warnings.end());
  for (const scene::Provenance& p : planned.loaded.provenance)
    warnings.insert(warnings.end(), p.warnings.begin(), p.warnings.end());
  for (std::string& warning : warnings_about_models(planned.loaded)) warnings.push_back(std::move(warning));
  for (std::string& text :
       render::unsupported_features(*registry.find(plan.renderer.name), planned.loaded.input))
    warnings.push_back(std::move(text));
  return warnings;
}

Result<int> run_plan(const PlanArguments& arguments, Context& context) {
  const render::Registry registry = all_renderers();
  PALPATE_ASSIGN(const PlannedScene planned, load_planned(arguments, registry, context.progress));
  const render::SceneInput& scene = planned.loaded.input;
  context.progress.report("asking the renderer", -1.0);
  PALPATE_ASSIGN(plan::Plan plan,
                 plan::make_plan(scene, planned.wanted, registry, {arguments.load.threads, nullptr}));
  expect_here(arguments, scene, registry, context, plan);
  std::optional<Checked> checked;
  if (arguments.check) {
    context.progress.report("preparing and stepping it", -1.0);
    context.working = true;
    PALPATE_ASSIGN(checked, check(plan, scene, arguments.load.threads, registry));
  }
  context.progress.clear();
  const std::vector<std::string> warnings = warnings_of(planned, plan, registry);
  if (arguments.json) {
    nlohmann::ordered_json document = json(plan);
    document["measured"] = json(checked);
    document["warnings"] = warnings;
    document["notes"] = planned.surfaces.notes;
    fmt::print("{}\n", document.dump(2));
    return kExitOk;
  }
  fmt::print("{}", plan::text(plan));
  if (checked) fmt::print("{}", text(*checked));
  for (const std::string& warning : warnings) tell("palpate: warning: {}\n", warning);
  for (const std::string& note : planned.surfaces.notes) tell("palpate: note: {}\n", note);
  return kExitOk;
}

}  // namespace

Subcommand plan_subcommand() {
  return subcommand(
      "info plan",
      "what will be built for a scene and why, with bytes and expected cost; only --check runs it",
      {"palpate info plan sinusoid:points=101761", "palpate info plan sinusoid:points=101761 --check",
       "palpate info plan scan.toml --renderer cloud --json"},
      declare_plan, run_plan);
}

}  // namespace palpate::experiments
