#include "experiments/ablate/ablate.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <optional>

#include "experiments/ablate/document.h"
#include "experiments/ablate/variants.h"
#include "experiments/run/choices.h"
#include "experiments/run/cleaning.h"
#include "experiments/run/run.h"
#include "experiments/session/terminal.h"
#include "toolkit/control/controlled_renderer.h"
#include "toolkit/core/instructions.h"
#include "toolkit/core/try.h"
#include "toolkit/trace/replay.h"
#include "toolkit/trace/trace_io.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPathFile = "path.csv";
constexpr double kPercent = 100.0;
/// Seconds of timed passes a variant.
constexpr double kTimedS = 1.0;

/// What is measured: the variants of a scene, and the stage that they stand on.
struct Plan {
  CheckedRun checked;
  Stage stage;
  std::vector<Variant> variants;
};

/// The scene as it would be without its steps of cleaning; nothing where it has none.
Result<std::optional<scene::LoadedScene>> without_cleaning(const StageRequest& request, Progress& progress) {
  scene::SceneFile file = request.scene;
  bool any = false;
  for (scene::SceneModel& model : file.models) {
    any |= !model.clean.empty();
    model.clean.clear();
  }
  if (!any) return std::optional<scene::LoadedScene>();
  PALPATE_ASSIGN(scene::LoadedScene loaded, scene::load(file, all_readers(), request.load, progress));
  return std::optional<scene::LoadedScene>(std::move(loaded));
}

Result<RendererRequest> chosen_renderer(const CheckedRun& checked, const Stage& stage,
                                        const render::Registry& registry) {
  if (checked.renderers.size() > 1)
    return Error{"--renderer takes one renderer", "measure one after the other", {}, 0};
  const RendererRequest request =
      !checked.renderers.empty() ? checked.renderers.front()
      : checked.own              ? *checked.own
                    : usual_renderers(stage.scene.input, checked.own, registry).renderers.front();
  PALPATE_TRY(registry.check_supports(*registry.find(request.name), stage.scene.input));
  return request;
}

/// Errors are bad input.
Status set_up_variants(const render::Registry& registry, int threads, Progress& progress, Plan& plan) {
  PALPATE_ASSIGN(plan.stage, set_up(plan.checked.stage, all_readers(), progress));
  PALPATE_ASSIGN(const RendererRequest request, chosen_renderer(plan.checked, plan.stage, registry));
  PALPATE_ASSIGN(const std::optional<scene::LoadedScene> uncleaned,
                 without_cleaning(plan.checked.stage, progress));
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> renderer,
                 registry.make(request.name, request.options));
  // Decided for the scene's own points: cleaning of the renderer does not change which stages there are.
  PALPATE_ASSIGN(const render::Decisions decided,
                 renderer->decide(plan.stage.scene.input, {threads, nullptr}));
  plan.variants =
      variants_of(plan.stage.scene, request, registry, decided, uncleaned ? &*uncleaned : nullptr);
  return Done{};
}

/// The stage with a variant's scene on it. A truth that does not know all that the scene asks for is left
/// out: forces would be compared with those of another surface.
Stage stage_of(const Stage& stage, const Variant& variant) {
  Stage seen;
  seen.scene_name = stage.scene_name;
  seen.scene = variant.scene;
  seen.path = stage.path;
  if (stage.forces_comparable) seen.reference = stage.reference;
  seen.starts_free = stage.starts_free;
  seen.forces_comparable = stage.forces_comparable;
  seen.spacing = stage.spacing;
  return seen;
}

/// Root mean square of the change of force, in percent of the whole scene's; nothing where that has none.
std::optional<double> change_percent(const trace::ForceTrace& whole, const trace::ForceTrace& rest) {
  double change = 0.0, all = 0.0;
  for (std::size_t i = 0; i < whole.frames.size() && i < rest.frames.size(); ++i) {
    change += (rest.frames[i].force_n - whole.frames[i].force_n).squaredNorm();
    all += whole.frames[i].force_n.squaredNorm();
  }
  if (!(all > 0.0)) return std::nullopt;
  return kPercent * std::sqrt(change / all);
}

AblateRow row_of(const Variant& variant, const Run& run) {
  AblateRow row;
  row.stage = variant.stage;
  row.instead = variant.instead;
  const metrics::RendererResult& result = run.result;
  if (result.status != metrics::RunStatus::kOk) {
    row.reason = result.reason;
    return row;
  }
  row.bytes = result.prepare->bytes;
  row.prepare_ms = result.prepare->total_ms;
  if (result.frame_all) row.frame_cpu_us = result.frame_all->cpu_mean_us;
  if (result.accuracy) row.truth_percent = result.accuracy->force_rms_percent;
  row.trace_hash = result.trace_hash;
  return row;
}

/// One variant after the other; the first one is what the others are compared with.
Status measure_variants(const Plan& plan, const render::Registry& registry, int threads,
                        ProgressBar& progress, AblateDocument& document) {
  RunOptions options;
  options.threads = threads;
  options.passes = kAblatePasses;
  options.budget_s = kTimedS;
  trace::ForceTrace whole;
  for (const Variant& variant : plan.variants) {
    progress.set_prefix(fmt::format("[{} of {}] {}: ", document.rows.size() + 1, plan.variants.size(),
                                    variant.stage.empty() ? "whole scene" : "without " + variant.stage));
    const Stage stage = stage_of(plan.stage, variant);
    PALPATE_ASSIGN(Run run, run_renderer(stage, variant.request, registry, options, progress));
    AblateRow row = row_of(variant, run);
    if (document.rows.empty()) {
      if (!row.reason.empty()) return Error{row.reason, "mend the scene, or take another renderer", {}, 0};
      whole = std::move(run.trace);
      for (const std::string& warning : run.result.prepare->warnings) document.warnings.push_back(warning);
    } else if (row.reason.empty()) {
      row.error_percent = change_percent(whole, run.trace);
    }
    document.rows.push_back(std::move(row));
  }
  progress.set_prefix("");
  return Done{};
}

/// Parts are told apart by the number of their variant.
std::string part_of(std::size_t variant) {
  return std::to_string(variant);
}

/// This program again, on the same variants and along the same path.
std::vector<std::string> marked_command(const AblateArguments& a, const std::string& path) {
  std::error_code code;
  std::vector<std::string> words = {
      fs::read_symlink("/proc/self/exe", code).string(), "ablate", a.run.scene, "--marked", "--path", path};
  const auto add = [&](const char* name, const std::string& value) {
    if (!value.empty()) words.insert(words.end(), {name, value});
  };
  const auto add_number = [&](const char* name, double value) {
    if (value > 0.0) add(name, fmt::format("{}", value));
  };
  add("--renderer", a.run.renderers);
  add("--stiffness", a.run.surface.stiffness);
  add("--friction", a.run.surface.friction);
  add("--deformation", a.run.surface.deformation);
  add("--unit", a.run.load.unit);
  add("--no-data", a.run.load.no_data);
  add("--non-finite", a.run.load.non_finite);
  add_number("--scale", a.run.load.scale);
  add_number("--post-mm", a.run.load.post_mm);
  add_number("--vertical-mm", a.run.load.vertical_mm);
  add_number("--memory-limit-gb", a.run.load.memory_limit_gb);
  return words;
}

void count_variants(const AblateArguments& arguments, const Plan& plan, const std::string& path,
                    ProgressBar& progress, AblateDocument& document) {
  if (!(arguments.budget_s > 0.0)) {
    document.counted = "Instructions were not counted: --budget is 0.";
    return;
  }
  CountOptions options{arguments.budget_s, [&](std::size_t parts) {
                         progress.report(
                             "counting instructions",
                             static_cast<double>(parts) / static_cast<double>(plan.variants.size()));
                         return true;
                       }};
  const auto parts = count_instructions(marked_command(arguments, path), options);
  if (!parts) {
    document.counted = fmt::format("Instructions were not counted ({}); CPU time stands in their place.",
                                   parts.error().what);
    return;
  }
  const auto frames = static_cast<double>(plan.stage.path.size());
  for (std::size_t i = 0; i < document.rows.size(); ++i)
    if (const auto part = parts->find(part_of(i)); part != parts->end() && document.rows[i].reason.empty())
      document.rows[i].instructions = static_cast<double>(part->second) / frames;
  document.counted = "Instructions are counted by callgrind: the same on every run.";
}

/// What is run under valgrind: each variant's frames between marks.
int step_marked(const AblateArguments& arguments, Plan& plan, const render::Registry& registry,
                Context& context) {
  const int threads = arguments.run.load.threads;
  if (const Status good = set_up_variants(registry, threads, context.progress, plan); !good)
    return fail(good.error(), kExitBadInput, &context.progress);
  const trace::ProbePath& path = plan.stage.path;
  for (std::size_t i = 0; i < plan.variants.size(); ++i) {
    Variant& variant = plan.variants[i];
    render::SceneInput& input = variant.scene.input;
    if (!variant.request.clean.empty()) {
      Result<CleanedScene> cleaned = clean_scene(input, variant.request.clean, threads, context.progress);
      if (!cleaned) continue;
      input = std::move(cleaned->input);
    }
    auto made = registry.make(variant.request.name, variant.request.options);
    if (!made) continue;
    const auto renderer = control::wrap(*std::move(made), variant.scene.control);
    if (!renderer->prepare(input, {threads, nullptr})) continue;
    render::Simulation* const simulation = input.simulation.get();
    if (!trace::replay(*renderer, path, simulation)) continue;  // what is done once is done
    if (simulation != nullptr) simulation->reset();
    renderer->restart(path.hip_mm[0], path.t_s[0] - (path.size() > 1 ? path.t_s[1] - path.t_s[0] : 1e-3));
    const std::string part = part_of(i);
    begin_counting();
    for (std::size_t k = 0; k < path.size(); ++k) {
      if (simulation != nullptr) simulation->advance(path.t_s[k]);
      (void)renderer->step(path.hip_mm[k], path.t_s[k]);
    }
    end_counting(part.c_str());
  }
  return kExitOk;
}

std::string renderer_text(const RendererRequest& request) {
  std::string text = request.name;
  for (const auto& [key, value] : request.options.all()) text += ":" + key + "=" + value;
  return text;
}

Status measure_all(const AblateArguments& arguments, const Plan& plan, const render::Registry& registry,
                   const OutputFolder& folder, Context& context, AblateDocument& document) {
  PALPATE_TRY(folder.begin("ablate"));
  PALPATE_ASSIGN(const std::string path, folder.claim(kPathFile));
  PALPATE_TRY(trace::write_path_csv(plan.stage.path, path));
  PALPATE_TRY(measure_variants(plan, registry, arguments.run.load.threads, context.progress, document));
  count_variants(arguments, plan, path, context.progress, document);
  PALPATE_TRY(write_ablate(document, folder));
  return folder.complete();
}

}  // namespace

int run_ablate(const AblateArguments& arguments, Context& context) {
  const render::Registry registry = all_renderers();
  Result<CheckedRun> checked = check_run(arguments.run, registry, context.progress);
  if (!checked) return fail(checked.error(), kExitBadInput, &context.progress);
  Plan plan{*std::move(checked), {}, {}};
  plan.checked.stage.usual_frames = kAblateFrames;
  if (arguments.marked) {
    plan.checked.stage.reference = ReferenceChoice::kNone;
    return step_marked(arguments, plan, registry, context);
  }
  const Result<OutputFolder> folder = OutputFolder::open(
      arguments.run.out.empty() ? usual_folder("ablate", arguments.run.scene) : arguments.run.out);
  if (!folder) return fail(folder.error(), kExitBadInput, &context.progress);
  if (const Status good = folder->check_not_read(files_read(plan.checked.stage)); !good)
    return fail(good.error(), kExitBadInput, &context.progress);
  if (const Status good = set_up_variants(registry, arguments.run.load.threads, context.progress, plan);
      !good)
    return fail(good.error(), kExitBadInput, &context.progress);
  AblateDocument document;
  document.head = new_head(context.command_line);
  document.scene = plan.stage.scene_name;
  document.path = plan.stage.path.name;
  document.renderer = renderer_text(plan.variants.front().request);
  if (plan.stage.reference && plan.stage.forces_comparable) document.truth = plan.stage.reference->name;
  document.warnings = plan.stage.warnings;
  document.notes = plan.stage.notes;
  if (const Status done = measure_all(arguments, plan, registry, *folder, context, document); !done)
    return fail(done.error(), kExitFellShort, &context.progress);
  context.progress.clear();
  if (arguments.run.json)
    fmt::print("{}", to_json(document));
  else
    fmt::print("{}\nreport: {}\n", to_text(ablate_table(document), terminal_columns(STDOUT_FILENO)),
               fs::absolute(folder->file("report.html")).string());
  const bool all_ran = std::all_of(document.rows.begin(), document.rows.end(),
                                   [](const AblateRow& row) { return row.reason.empty(); });
  return all_ran ? kExitOk : kExitFellShort;
}

}  // namespace palpate::experiments
