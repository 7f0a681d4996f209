#include "experiments/ablate/ablate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include <palpate/control.h>
#include <palpate/replay.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/driver/json_document.h"
#include "experiments/driver/suite.h"
#include "experiments/run/arguments.h"
#include "experiments/run/run.h"
#include "experiments/run/stage.h"
#include "experiments/run/work.h"
#include "toolkit/core/instruction_counter.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPathFile = "path.csv";
constexpr const char* kWholePart = "whole";  ///< the part of the whole scene
constexpr double kPercent = 100.0;
/// Seconds of timed passes per variant.
constexpr double kTimedS = 1.0;

struct Plan {
  CheckedRun checked;
  Stage stage;
  std::vector<Variant> variants;
};

/// The scene without its cleaning steps; empty if it has none.
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
    return Error{"--renderer takes one renderer", "measure one after the other"};
  const RendererRequest request =
      !checked.renderers.empty() ? checked.renderers.front()
      : checked.own              ? *checked.own
                    : usual_renderers(stage.scene.input, checked.own, registry).renderers.front();
  PALPATE_TRY(registry.check_supports(*registry.find(request.name), stage.scene.input));
  return request;
}

/// Errors: bad input.
Status set_up_variants(const render::Registry& registry, int threads, Progress& progress, Plan& plan) {
  PALPATE_ASSIGN(plan.stage, set_up(plan.checked.stage, all_readers(), progress));
  PALPATE_ASSIGN(const RendererRequest request, chosen_renderer(plan.checked, plan.stage, registry));
  PALPATE_ASSIGN(const std::optional<scene::LoadedScene> uncleaned,
                 without_cleaning(plan.checked.stage, progress));
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> renderer,
                 registry.make(request.name, request.options));
  // Decided for the scene's own points: the renderer's cleaning does not change which stages exist.
  PALPATE_ASSIGN(const render::Decisions decided,
                 renderer->decide(plan.stage.scene.input, {threads, nullptr}));
  plan.variants =
      variants_of(plan.stage.scene, request, registry, decided, uncleaned ? &*uncleaned : nullptr);
  return Done{};
}

/// The stage with a variant's scene. Drops a truth that does not cover the scene, since it belongs to another
/// surface.
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

/// RMS change of force in percent of the whole scene's force; empty without any.
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

std::string part_of(std::size_t variant) {
  return std::to_string(variant);
}

/// The whole scene's run, the reference of the others; its trace stays in the folder.
Result<Run> measure_whole(const Stage& stage, const Variant& variant, const render::Registry& registry,
                          const RunOptions& options, const Suite& suite) {
  Run run;
  const OutputFolder& folder = suite.folder();
  if (take_run(folder, kWholePart, kWholePart, stage, run)) return run;
  PALPATE_ASSIGN(run, run_renderer(stage, variant.request, registry, options, suite.progress()));
  if (run.result.status != metrics::RunStatus::kOk)
    return Error{run.result.reason, "mend the scene, or take another renderer"};
  folder.start_part();
  PALPATE_TRY(write_run(stage, run, true, folder));
  PALPATE_TRY(folder.keep(kWholePart, kWholePart, result_text(run)));
  return run;
}

/// Measures the variants in order; the first is the reference.
Status measure_variants(const Plan& plan, const render::Registry& registry, int threads, const Suite& suite,
                        AblateDocument& document) {
  RunOptions options;
  options.threads = threads;
  options.passes = kAblatePasses;
  options.budget_s = kTimedS;
  std::size_t points = 0;
  for (const render::ModelInput& model : plan.stage.scene.input.models) points += model.cloud->size();
  const double frames = static_cast<double>((2 * kAblatePasses + 1) * plan.stage.path.size());
  std::optional<Run> whole;
  const auto need_whole = [&]() -> Status {
    if (!whole) {
      const Variant& variant = plan.variants.front();
      PALPATE_ASSIGN(whole, measure_whole(stage_of(plan.stage, variant), variant, registry, options, suite));
    }
    return Done{};
  };
  for (std::size_t i = 0; i < plan.variants.size(); ++i) {
    const Variant& variant = plan.variants[i];
    suite.progress().set_prefix(
        fmt::format("[{} of {}] {}: ", i + 1, plan.variants.size(),
                    variant.stage.empty() ? "whole scene" : "without " + variant.stage));
    // A variant in a process of its own measures the whole scene first.
    Case about = case_of(variant.request, *registry.find(variant.request.name), plan.stage.scene_name, points,
                         2.0 * frames, 2.0);
    about.setting = variant.stage;
    if (i == 0) {
      about.name = kWholePart;
      if (!suite.measures(about)) continue;
      PALPATE_TRY(need_whole());
      document.rows.push_back(row_of(variant, *whole));
      for (const std::string& warning : whole->result.prepare->warnings) document.warnings.push_back(warning);
      continue;
    }
    const auto measure = [&]() -> Result<AblateRow> {
      PALPATE_TRY(need_whole());
      const Stage stage = stage_of(plan.stage, variant);
      PALPATE_ASSIGN(const Run run,
                     run_renderer(stage, variant.request, registry, options, suite.progress()));
      AblateRow measured = row_of(variant, run);
      if (measured.reason.empty()) measured.error_percent = change_percent(whole->trace, run.trace);
      return measured;
    };
    PALPATE_ASSIGN(AblateRow row, suite.once<AblateRow>(part_of(i), variant.stage, measure, about));
    document.rows.push_back(std::move(row));
  }
  suite.progress().set_prefix("");
  return Done{};
}

/// Command that runs this program on the same variants along the same path.
std::vector<std::string> marked_command(const AblateArguments& a, const std::string& path) {
  std::error_code code;
  std::vector<std::string> words = {fs::read_symlink("/proc/self/exe", code).string(),
                                    "compare",
                                    "ablate",
                                    a.run.scene,
                                    "--marked",
                                    "--path",
                                    path};
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
  add("--within", a.run.load.within);
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

/// Runs under valgrind: each variant's frames between marks.
void count_frame_instructions(Plan& plan, const render::Registry& registry, int threads, Progress& progress) {
  const trace::ProbePath& path = plan.stage.path;
  for (std::size_t i = 0; i < plan.variants.size(); ++i) {
    Variant& variant = plan.variants[i];
    render::SceneInput& input = variant.scene.input;
    if (!variant.request.clean.empty()) {
      Result<CleanedScene> cleaned = clean_scene(input, variant.request.clean, threads, progress);
      if (!cleaned) continue;
      input = std::move(cleaned->input);
    }
    auto made = registry.make(variant.request.name, variant.request.options);
    if (!made) continue;
    const auto renderer = control::wrap(*std::move(made), variant.scene.control);
    if (!renderer->prepare(input, {threads, nullptr})) continue;
    render::Simulation* const simulation = input.simulation.get();
    if (!trace::replay(*renderer, path, simulation)) continue;  // warm-up
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
}

std::string renderer_text(const RendererRequest& request) {
  std::string text = request.name;
  for (const auto& [key, value] : request.options.all()) text += ":" + key + "=" + value;
  return text;
}

}  // namespace

Result<int> run_ablate(const AblateArguments& arguments, Context& context) {
  Suite suite(context);
  const RunArguments& run = arguments.run;
  const int threads = run.load.threads;
  const render::Registry registry = all_renderers();
  PALPATE_ASSIGN(CheckedRun checked, check_run(run, registry, suite.progress()));
  Plan plan{std::move(checked), {}, {}};
  plan.checked.stage.usual_frames = kAblateFrames;
  if (arguments.marked) {
    plan.checked.stage.reference = ReferenceChoice::kNone;
    PALPATE_TRY(set_up_variants(registry, threads, suite.progress(), plan));
    count_frame_instructions(plan, registry, threads, suite.progress());
    return kExitOk;
  }
  PALPATE_TRY(open_folder(run, "ablate", plan.checked.stage, suite));
  PALPATE_TRY(set_up_variants(registry, threads, suite.progress(), plan));
  AblateDocument document;
  document.head = new_head(context.command_line);
  document.scene = plan.stage.scene_name;
  document.path = plan.stage.path.name;
  document.renderer = renderer_text(plan.variants.front().request);
  if (plan.stage.reference && plan.stage.forces_comparable) document.truth = plan.stage.reference->name;
  document.warnings = plan.stage.warnings;
  document.notes = plan.stage.notes;
  PALPATE_TRY(suite.begin(key_of(run, plan.checked.stage).add(document.renderer)));
  PALPATE_TRY(measure_variants(plan, registry, threads, suite, document));
  if (suite.partial()) return suite.leave();
  PALPATE_ASSIGN(const std::string path, suite.folder().claim(kPathFile));
  PALPATE_TRY(trace::write_path_csv(plan.stage.path, path));
  count_variants(arguments, plan, path, suite.progress(), document);
  PALPATE_TRY(suite.publish({kAblateFile, to_json(document), {ablate_table(document)}}, ablate_page(document),
                            run.json));
  const bool all_ran = std::all_of(document.rows.begin(), document.rows.end(),
                                   [](const AblateRow& row) { return row.reason.empty(); });
  return all_ran ? kExitOk : kExitFellShort;
}

PALPATE_JSON_MEMBERS(AblateDocument, scene, path, renderer, truth, counted, warnings, notes, rows)

namespace {

constexpr const char* kWhole = "nothing: the whole scene";
/// Smaller changes are imperceptible (Weber's fraction of force, 7 %).
constexpr double kFeltPercent = 7.0;

/// Saving without the stage; negative for an increase.
template <class T>
std::optional<double> saved(const std::optional<T>& whole, const std::optional<T>& rest) {
  if (!whole || !rest) return std::nullopt;
  return static_cast<double>(*whole) - static_cast<double>(*rest);
}

/// Conclusions from a row and the whole scene's.
DocumentJson conclusions_of(const AblateRow& row, const AblateRow& whole) {
  return {{"stage", text_or_null(row.stage)},
          {"status", row.reason.empty() ? "ok" : "failed"},
          {"saves",
           {{"instructions", saved(whole.instructions, row.instructions)},
            {"frame_cpu_us", saved(whole.frame_cpu_us, row.frame_cpu_us)},
            {"bytes", saved(whole.bytes, row.bytes)},
            {"prepare_ms", saved(whole.prepare_ms, row.prepare_ms)}}}};
}

/// "512 (-104)": value without the stage and its difference to the whole scene.
template <class T>
Cell with_change(const std::optional<T>& value, const std::optional<T>& whole, bool is_whole) {
  if (!value) return {kMissingNumber};
  const double number = static_cast<double>(*value);
  if (is_whole || !whole) return {format_number(number)};
  const double change = number - static_cast<double>(*whole);
  if (change == 0.0) return {format_number(number) + " (0)"};
  return {fmt::format("{} ({}{})", format_number(number), change > 0.0 ? "+" : "-",
                      format_number(std::abs(change)))};
}

Cell percent_cell(const std::optional<double>& percent) {
  return {percent ? format_number(*percent) : std::string(kMissingNumber)};
}

/// The stage's cost in time and memory, and the loss without it.
Headline ablate_headline(const AblateRow& row, const AblateRow& whole) {
  if (!row.reason.empty()) return {row.stage, "cannot be left out: " + row.reason};
  std::string text;
  if (const std::optional<double> instructions = saved(whole.instructions, row.instructions))
    text += fmt::format("{} instructions a frame, ", format_number(*instructions));
  else if (const std::optional<double> us = saved(whole.frame_cpu_us, row.frame_cpu_us))
    text += fmt::format("{} µs a frame, ", format_number(*us));
  if (const std::optional<double> bytes = saved(whole.bytes, row.bytes))
    text += fmt::format("{} bytes; ", format_number(*bytes));
  if (!row.error_percent) return {row.stage, text + "nothing was in contact to tell what is lost"};
  text += fmt::format("without it the force changes by {} %", format_number(*row.error_percent));
  if (!(*row.error_percent > 0.0))
    text += ": along this path the scene does not require it";
  else if (*row.error_percent < kFeltPercent)
    text += fmt::format(", less than the {:g} % that a hand can tell", kFeltPercent);
  return {row.stage, text};
}

}  // namespace

std::string to_json(const AblateDocument& document) {
  DocumentJson json = begin_json(kAblateSchema, document.head);
  to_json(json, document);
  json["truth"] = text_or_null(document.truth);
  for (std::size_t i = 0; i < document.rows.size(); ++i)
    json["rows"][i].update(conclusions_of(document.rows[i], document.rows.front()));
  return document_text(json);
}

Table ablate_table(const AblateDocument& document) {
  Table table;
  table.title = fmt::format("{}: each stage left out in turn", document.renderer);
  table.columns = {"left out", "in its place",    "instructions a frame", "CPU µs a frame",
                   "bytes",    "ready after, ms", "force changes by, %",  "error, %"};
  const AblateRow& whole = document.rows.front();
  for (const AblateRow& row : document.rows) {
    const bool is_whole = row.stage.empty();
    table.rows.push_back({{is_whole ? kWhole : row.stage},
                          {row.reason.empty() ? row.instead : row.reason},
                          with_change(row.instructions, whole.instructions, is_whole),
                          with_change(row.frame_cpu_us, whole.frame_cpu_us, is_whole),
                          with_change(row.bytes, whole.bytes, is_whole),
                          with_change(row.prepare_ms, whole.prepare_ms, is_whole),
                          is_whole ? Cell{kMissingNumber} : percent_cell(row.error_percent),
                          percent_cell(row.truth_percent)});
  }
  table.notes = {
      "In brackets: the change against the whole scene. Frames are all of the path, in contact and free.",
      "\"Force changes by\" is the root mean square of the change, in percent of the whole scene's "
      "force; \"error\" is against the ground truth, where that knows all that the scene asks for.",
      document.counted};
  return table;
}

Page ablate_page(const AblateDocument& document) {
  Page page = begin_page("Stages that the scene requires", document.head);
  add_known(page, Known{{}, document.warnings, document.notes});
  HeadlineGroup group{"Cost of each stage, and loss without it", {}};
  for (std::size_t i = 1; i < document.rows.size(); ++i)
    group.lines.push_back(ablate_headline(document.rows[i], document.rows.front()));
  if (group.lines.empty())
    group.lines.push_back({"Nothing can be left out", "the scene asks for points and a spring alone"});
  page.headlines.push_back(std::move(group));
  Section section;
  section.id = "stages";
  section.title = "Each stage left out in turn";
  section.tables.push_back(ablate_table(document));
  section.facts = {
      {"scene", {document.scene}},
      {"path", {document.path}},
      {"renderer", {document.renderer}},
      {"instructions", {document.counted}},
      {"ground truth",
       {document.truth.empty() ? "none that knows all that the scene asks for" : document.truth}}};
  page.sections.push_back(std::move(section));
  return page;
}

}  // namespace palpate::experiments
