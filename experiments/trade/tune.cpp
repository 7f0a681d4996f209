#include "experiments/trade/sweep.h"

#include <fmt/format.h>
#include <toml++/toml.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <sstream>

#include <palpate/result.h>
#include "experiments/data/scans.h"
#include "experiments/driver/json_document.h"
#include "experiments/run/arguments.h"
#include "experiments/session/session.h"
#include "experiments/session/version.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

// Tries of the next best when a repeated measurement exceeds a limit.
constexpr std::size_t kMostTries = 3;

struct Tried {
  Row found, verified;
  bool keeps = false;
};

TuneLimits limits_of(const TuneArguments& arguments) {
  TuneLimits limits;
  if (arguments.max_error >= 0.0) limits.error_percent = arguments.max_error;
  if (arguments.max_frame_us >= 0.0) limits.frame_us = arguments.max_frame_us;
  if (arguments.max_bytes >= 0.0) limits.bytes = arguments.max_bytes;
  return limits;
}

double ratio_to(double value, double limit) {
  if (value <= limit) return limit > 0.0 ? value / limit : 1.0;
  return limit > 0.0 ? value / limit : std::numeric_limits<double>::infinity();
}

std::string numbers_text(const Row& row) {
  return fmt::format("error {} % (up to {}), 99.9 % of frames under {} µs (up to {}), {}, ready after {}",
                     format_number(row.error_p95_percent->value),
                     format_number(row.error_p95_percent->high()), format_number(row.frame_p999_us->value),
                     format_number(row.frame_p999_us->high()), format_bytes(static_cast<double>(*row.bytes)),
                     format_duration(row.prepare_ms->value));
}

std::string limits_text(const TuneLimits& limits) {
  std::vector<std::string> all;
  if (limits.error_percent)
    all.push_back(fmt::format("an error of at most {} %", format_number(*limits.error_percent)));
  if (limits.frame_us)
    all.push_back(fmt::format("99.9 % of frames within {} µs", format_number(*limits.frame_us)));
  if (limits.bytes) all.push_back(fmt::format("at most {} of memory", format_bytes(*limits.bytes)));
  return joined(all, " and ");
}

/// Loads the written scene and measures its renderer along the same path.
Result<Row> verify(const std::string& scene_file, const Sweep& sweep, const TuneArguments& arguments,
                   const render::Registry& registry, Progress& progress) {
  StageRequest request = sweep.checked().stage;
  PALPATE_ASSIGN(request.scene, open_scene(scene_file, registry, progress));
  request.scene_name = scene_file;
  // The scene file now contains these.
  request.load.unit.reset();
  request.load.scale.reset();
  request.load.post_mm = request.load.vertical_mm = 0.0;
  request.load.no_data.reset();
  request.load.within_mm.reset();
  PALPATE_ASSIGN(const Stage stage, set_up(request, all_readers(), progress));
  PALPATE_ASSIGN(const Experiment experiment,
                 experiment_on(stage, fmt::format("{} {}", version_text(), kCommit)));
  if (experiment.hash != sweep.experiment().hash)
    return Error{"is not the scene that was swept: its points, path or truth came out otherwise",
                 "report this as a defect, with the scene", scene_file};
  PALPATE_ASSIGN(RendererRequest renderer, request_of(*request.scene.renderer, registry));
  renderer.label = renderer.name;
  const Setting setting{renderer.name, std::move(renderer), request.scene.renderer->options, 0, 1, {}};
  MeasureOptions options;
  options.threads = arguments.sweep.run.load.threads;
  options.passes = kUsualPasses;
  options.budget_s = kUsualBudgetS;
  options.prepare_limit_s = 0.0;
  PALPATE_ASSIGN(std::vector<Row> rows,
                 measure(experiment, {&setting, 1}, setting, registry, options, progress));
  return std::move(rows.front());
}

std::string tune_json(const Sweep& sweep, const TuneLimits& limits, const std::vector<Tried>& tried,
                      std::size_t kept, const std::optional<Row>& nearest, Context& context) {
  DocumentJson json = begin_json(kTuneSchema, new_head(context.command_line));
  json["scene"] = sweep.document().scene;
  json["path"] = sweep.document().path;
  json["truth"] = sweep.document().truth;
  json["asked"] = {{"max_error_percent", limits.error_percent},
                   {"max_frame_us", limits.frame_us},
                   {"max_bytes", limits.bytes}};
  const bool found = !tried.empty() && tried.back().keeps;
  json["chosen"] = found ? DocumentJson::parse(measured_text(tried.back().found)) : DocumentJson(nullptr);
  json["scene_file"] = found ? DocumentJson(kTunedScene) : DocumentJson(nullptr);
  json["nearest"] = nearest ? DocumentJson::parse(measured_text(*nearest)) : DocumentJson(nullptr);
  DocumentJson tries = DocumentJson::array();
  for (const Tried& one : tried)
    tries.push_back({{"setting", one.found.setting},
                     {"keeps", one.keeps},
                     {"verified", DocumentJson::parse(measured_text(one.verified))}});
  json["evidence"] = {{"rows", kRowsFile},
                      {"measured", sweep.document().rows.size()},
                      {"not_measured", sweep.document().not_measured.size()},
                      {"kept_the_limits", kept},
                      {"tried", tries}};
  return document_text(json);
}

/// Writes and runs the best scenes in turn until one keeps the limits.
Result<std::vector<Tried>> try_out(const Sweep& sweep, const std::vector<std::size_t>& best,
                                   const TuneLimits& limits, const TuneArguments& arguments,
                                   const render::Registry& registry, Context& context) {
  std::vector<Tried> tried;
  for (std::size_t i = 0; i < std::min(best.size(), kMostTries); ++i) {
    const Row& row = sweep.document().rows[best[i]];
    NamedOptions named{row.renderer, {}};
    for (const auto& [key, value] : row.options) named.options.set(key, value);
    PALPATE_ASSIGN(const std::string text, tuned_scene(sweep.checked(), arguments.sweep.run.load, named));
    PALPATE_TRY(sweep.suite().folder().write(
        kTunedScene,
        fmt::format("# By palpate tune, for {}: {}.\n{}", limits_text(limits), numbers_text(row), text)));
    context.progress.report("running " + row.setting + " again", -1.0);
    PALPATE_ASSIGN(Row verified, verify(sweep.suite().folder().file(kTunedScene).string(), sweep, arguments,
                                        registry, context.progress));
    tried.push_back({row, std::move(verified), false});
    tried.back().keeps = excess(tried.back().verified, limits) <= 1.0;
    if (tried.back().keeps) break;
  }
  return tried;
}

Status drop_scene(const OutputFolder& folder) {
  PALPATE_ASSIGN(const std::string file, folder.claim(kTunedScene));
  std::error_code code;
  std::filesystem::remove(file, code);
  return Done{};
}

Error nothing_keeps(const Sweep& sweep, const TuneLimits& limits, const std::vector<Tried>& tried,
                    const std::optional<Row>& nearest) {
  std::string what = fmt::format("no setting of {} keeps {}", format_count(sweep.document().rows.size()),
                                 limits_text(limits));
  if (!tried.empty())
    what = fmt::format("{} kept {} when it was measured, and not when it was run again",
                       tried.front().found.setting, limits_text(limits));
  return {what,
          nearest ? fmt::format("the nearest is {}: {}", nearest->setting, numbers_text(*nearest))
                  : "none ran to its end: the report says why",
          {},
          0};
}

/// The sweep's page, which answers first: the setting to take, what was asked of it and what was measured; or
/// why there is none, and the nearest.
Page tune_page(const Sweep& sweep, const TuneLimits& limits, const std::vector<Tried>& tried,
               std::size_t kept, const std::optional<Row>& nearest) {
  Page page = sweep_page(sweep.document(), sweep.suite().folder());
  page.title = "The setting to take within limits";
  Table table;
  table.columns = {"", "error, %", "99.9 % of frames, µs", "memory", "ready after"};
  const std::optional<double>& bytes = limits.bytes;
  table.rows.push_back(
      plain_row({"asked: at most", format_number(limits.error_percent), format_number(limits.frame_us),
                 bytes ? format_bytes(*bytes) : kMissingNumber, kMissingNumber}));
  const auto add = [&](const std::string& name, const Row& row) {
    if (!row.ok()) return;
    table.rows.push_back(
        plain_row({name,
                   fmt::format("{} (up to {})", format_number(row.error_p95_percent->value),
                               format_number(row.error_p95_percent->high())),
                   fmt::format("{} (up to {})", format_number(row.frame_p999_us->value),
                               format_number(row.frame_p999_us->high())),
                   format_bytes(static_cast<double>(*row.bytes)), format_duration(row.prepare_ms->value)}));
  };
  if (!tried.empty() && tried.back().keeps) {
    table.title = tried.back().found.setting;
    add("measured", tried.back().found);
    add("run again", tried.back().verified);
    table.notes = {fmt::format("Kept by {} of {} settings.", kept, sweep.document().rows.size())};
    page.answers.push_back(
        {"Take",
         fmt::format("{}: {} that keeps {}, when measured and when run again.", table.title,
                     limits.error_percent ? "the cheapest" : "the most accurate", limits_text(limits))});
  } else {
    const Error none = nothing_keeps(sweep, limits, tried, nearest);
    page.answers.push_back({"Nothing", fmt::format("{}; {}.", none.what, none.remedy)});
    if (nearest) {
      table.title = nearest->setting;
      add("measured", *nearest);
    }
  }
  page.tables = {std::move(table)};
  return page;
}

}  // namespace

double excess(const Row& row, const TuneLimits& limits) {
  double most = 0.0;
  if (!row.ok()) return std::numeric_limits<double>::infinity();
  if (limits.error_percent)
    most = std::max(most, ratio_to(row.error_p95_percent->high(), *limits.error_percent));
  if (limits.frame_us) most = std::max(most, ratio_to(row.frame_p999_us->high(), *limits.frame_us));
  if (limits.bytes) most = std::max(most, ratio_to(static_cast<double>(*row.bytes), *limits.bytes));
  return most;
}

std::vector<std::size_t> candidates(const std::vector<Row>& rows, const TuneLimits& limits) {
  std::vector<std::size_t> all;
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (excess(rows[i], limits) <= 1.0) all.push_back(i);
  const auto first = [&](const Row& row) {
    return limits.error_percent ? *row.load_percent : *row.error_p95_percent;
  };
  const auto second = [&](const Row& row) {
    return limits.error_percent ? static_cast<double>(*row.bytes) : row.load_percent->value;
  };
  std::stable_sort(all.begin(), all.end(),
                   [&](std::size_t a, std::size_t b) { return first(rows[a]).value < first(rows[b]).value; });
  // Errors are over the same frames: overlapping intervals over few episodes do not make them equal.
  const auto alike = [&](const Measured& best, const Measured& other) {
    if (limits.error_percent) return !surely_less(best, other);
    return other.value <= (1.0 + kSameError) * best.value;
  };
  // Orders indistinguishable rows by the second number.
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Measured best = first(rows[all[i]]);
    std::size_t least = i;
    for (std::size_t k = i + 1; k < all.size(); ++k)
      if (alike(best, first(rows[all[k]])) && second(rows[all[k]]) < second(rows[all[least]])) least = k;
    std::rotate(all.begin() + static_cast<std::ptrdiff_t>(i),
                all.begin() + static_cast<std::ptrdiff_t>(least),
                all.begin() + static_cast<std::ptrdiff_t>(least) + 1);
  }
  return all;
}

std::optional<std::size_t> nearest_miss(const std::vector<Row>& rows, const TuneLimits& limits) {
  std::optional<std::size_t> nearest;
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (rows[i].ok() && (!nearest || excess(rows[i], limits) < excess(rows[*nearest], limits))) nearest = i;
  return nearest;
}

Result<int> run_tune(const TuneArguments& arguments, Context& context) {
  const TuneLimits limits = limits_of(arguments);
  if (!limits.any())
    return Error{"nothing is asked for", "give --max-error, --max-frame-us or --max-bytes, or several"};
  const render::Registry registry = all_renderers();
  SweepArguments sweep_arguments = arguments.sweep;
  sweep_arguments.tunes = true;
  if (sweep_arguments.run.out.empty())
    sweep_arguments.run.out = usual_folder("tune", sweep_arguments.run.scene);
  PALPATE_ASSIGN(const std::unique_ptr<Sweep> begun, Sweep::begin(sweep_arguments, registry, context));
  Sweep& sweep = *begun;
  PALPATE_TRY(sweep.measure_all());
  if (sweep.suite().partial()) return sweep.suite().leave();
  const SweepDocument& document = sweep.document();
  const OutputFolder& folder = sweep.suite().folder();
  // Only rows of this machine that a scene file can express.
  std::vector<Row> rows = document.rows;
  const std::string here = this_machine().hash;
  for (Row& row : rows)
    if (row.machine.hash != here || row.precision_bits > 0 || row.rate_divisor > 1) row.status = "failed";
  const std::vector<std::size_t> best = candidates(rows, limits);
  PALPATE_ASSIGN(const std::vector<Tried> tried, try_out(sweep, best, limits, arguments, registry, context));
  const bool found = !tried.empty() && tried.back().keeps;
  std::optional<Row> nearest;
  if (const auto at = nearest_miss(rows, limits); !found && at) nearest = document.rows[*at];
  if (!found) PALPATE_TRY(drop_scene(folder));
  const std::string json = tune_json(sweep, limits, tried, best.size(), nearest, context);
  PALPATE_TRY(folder.write(kTuneFile, json));
  PALPATE_TRY(sweep.suite().write({kSweepFile, to_json(document), {}},
                                  tune_page(sweep, limits, tried, best.size(), nearest)));
  context.progress.clear();
  if (arguments.sweep.run.json) fmt::print("{}", json);
  if (!found) return nothing_keeps(sweep, limits, tried, nearest);
  if (arguments.sweep.run.json) return kExitOk;
  const Tried& chosen = tried.back();
  fmt::print("{}\n  measured:  {}\n  run again: {}\nkept by {} of {} settings\nscene: {}\nreport: {}\n",
             chosen.found.setting, numbers_text(chosen.found), numbers_text(chosen.verified), best.size(),
             rows.size(), std::filesystem::absolute(folder.file(kTunedScene)).string(),
             std::filesystem::absolute(folder.file(kReportFile)).string());
  return kExitOk;
}

namespace {

namespace fs = std::filesystem;

/// Writes numbers and flags bare, all else in quotes.
void set_option(toml::table& table, const std::string& key, const std::string& value) {
  if (const Result<long long> whole = parse_integer(value))
    table.insert_or_assign(key, std::int64_t{*whole});
  else if (const Result<double> number = parse_number(value))
    table.insert_or_assign(key, *number);
  else if (value == "true" || value == "false")
    table.insert_or_assign(key, value == "true");
  else
    table.insert_or_assign(key, value);
}

std::string absolute_path(const std::string& path, const fs::path& folder) {
  return fs::absolute(fs::path(path).is_absolute() ? fs::path(path) : folder / path)
      .lexically_normal()
      .string();
}

void make_absolute(toml::node* table, const char* key, const fs::path& folder) {
  if (table == nullptr || !table->is_table()) return;
  if (const auto path = (*table->as_table())[key].value<std::string>())
    table->as_table()->insert_or_assign(key, absolute_path(*path, folder));
}

void make_model_absolute(toml::table& model, const fs::path& folder) {
  make_absolute(&model, "cloud", folder);
  if (toml::array* views = model["view"].as_array())
    for (toml::node& view : *views) make_absolute(&view, "cloud", folder);
  make_absolute(model["surface"]["friction"].node(), "image", folder);
  make_absolute(model["surface"]["texture"].node(), "image", folder);
}

/// Writes the command line's load settings as load() reads them.
void add_load(toml::table& model, const ModelArguments& load) {
  const bool of_file = model.contains("cloud") || model.contains("scan");
  if (of_file && !load.unit.empty() && !model.contains("unit")) model.insert_or_assign("unit", load.unit);
  if (load.scale > 0.0) model.insert_or_assign("scale", load.scale);
  if (of_file && load.post_mm > 0.0) model.insert_or_assign("post_mm", load.post_mm);
  if (of_file && load.vertical_mm > 0.0) model.insert_or_assign("vertical_mm", load.vertical_mm);
  if (of_file && !load.no_data.empty())
    if (const Result<double> number = parse_number(load.no_data)) model.insert_or_assign("no_data", *number);
  if (!of_file || load.within.empty()) return;
  if (const Result<geometry::Aabb> box = parse_within(load.within)) {
    const Vec3 &low = box->low_mm, &high = box->high_mm;
    model.insert_or_assign("within_mm", toml::array{toml::array{low.x(), low.y(), low.z()},
                                                    toml::array{high.x(), high.y(), high.z()}});
  }
}

/// A scene of one model named on the command line.
toml::table of_model(const scene::SceneModel& model) {
  toml::table table;
  if (model.generate) {
    table.insert_or_assign("generate", model.generate->name);
    for (const auto& [key, value] : model.generate->options.all()) set_option(table, key, value);
  } else if (!model.scan.empty()) {
    table.insert_or_assign("scan", model.scan);
  } else {
    table.insert_or_assign("cloud", absolute_path(model.cloud, fs::current_path()));
  }
  toml::array models;
  models.push_back(std::move(table));
  toml::table scene;
  scene.insert_or_assign("model", std::move(models));
  return scene;
}

Result<toml::table> of_file(const std::string& path) {
  PALPATE_ASSIGN(const std::string text, read_file(path, scene::kMaxSceneBytes));
  try {
    toml::table scene = toml::parse(text);
    if (toml::array* models = scene["model"].as_array())
      for (toml::node& model : *models)
        if (model.is_table()) make_model_absolute(*model.as_table(), fs::absolute(path).parent_path());
    return scene;
  } catch (const toml::parse_error& error) {
    return Error{
        std::string(error.description()), {}, path, static_cast<std::int64_t>(error.source().begin.line)};
  }
}

}  // namespace

Result<std::string> tuned_scene(const CheckedRun& checked, const ModelArguments& load,
                                const NamedOptions& renderer) {
  const scene::SceneFile& scene = checked.stage.scene;
  toml::table whole;
  if (fs::path(scene.path).extension() == ".toml") {
    PALPATE_ASSIGN(whole, of_file(scene.path));
  } else {
    whole = of_model(scene.models.front());
  }
  if (toml::array* models = whole["model"].as_array())
    for (toml::node& model : *models)
      if (model.is_table()) add_load(*model.as_table(), load);
  toml::table own;
  own.insert_or_assign("name", renderer.name);
  for (const auto& [key, value] : renderer.options.all()) set_option(own, key, value);
  whole.insert_or_assign("renderer", std::move(own));
  std::ostringstream text;
  text << whole << "\n";
  return text.str();
}

}  // namespace palpate::experiments
