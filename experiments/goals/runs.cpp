#include <fmt/format.h>

#include <palpate/result.h>
#include "experiments/data/scans.h"
#include "experiments/driver/json_document.h"
#include "experiments/goals/goals.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {

/// A run without its traces.
static void to_json(nlohmann::json& json, const GoalRuns& runs) {
  metrics::ResultDocument document;
  document.renderers = runs.results;
  json = {{"name", runs.name}, {"points", runs.points}, {"results", metrics::to_json(document)}};
}
static void from_json(const nlohmann::json& json, GoalRuns& runs) {
  Result<metrics::ResultDocument> document =
      metrics::parse_result(json.at("results").get<std::string>(), "a kept run");
  if (!document) throw nlohmann::json::other_error::create(0, document.error().what, nullptr);
  runs = {json.at("name").get<std::string>(), json.at("points").get<std::uint64_t>(),
          std::move(document->renderers)};
}

namespace {

/// Timed passes with quick and of a measurement.
constexpr std::uint64_t kQuickPasses = 2, kGoalPasses = 8;
constexpr double kQuickBudgetS = 0.5, kGoalBudgetS = 3.0;
constexpr double kGoalPrepareLimitS = 300.0;

}  // namespace

Result<Stage> goal_stage(const GoalBench& bench, const std::string& scene, const std::string& path,
                         ReferenceChoice reference) {
  Progress& progress = bench.suite.progress();
  PALPATE_ASSIGN(scene::SceneFile file, open_scene(scene, bench.registry, progress));
  StageRequest request;
  request.scene_name = scene;
  request.scene = std::move(file);
  request.path = path;
  request.reference = reference;
  request.threads = bench.threads;
  return set_up(request, all_readers(), progress);
}

Result<GoalRuns> goal_runs(const GoalBench& bench, const Stage& stage, const std::string& name,
                           const std::string& renderers) {
  PALPATE_ASSIGN(const std::vector<RendererRequest> requests, parse_renderers(renderers, bench.registry));
  RunOptions options;
  options.threads = bench.threads;
  options.passes = bench.quick ? kQuickPasses : kGoalPasses;
  options.budget_s = bench.quick ? kQuickBudgetS : kGoalBudgetS;
  options.prepare_limit_s = kGoalPrepareLimitS;
  metrics::MeasurementConditions conditions;
  PALPATE_ASSIGN(std::vector<Run> runs, run_renderers(stage, requests, bench.registry, options,
                                                      bench.suite.progress(), conditions, {}));
  GoalRuns out;
  out.name = name;
  for (const render::ModelInput& model : stage.scene.input.models) out.points += model.cloud->size();
  for (Run& run : runs) {
    out.results.push_back(std::move(run.result));
    out.traces.push_back(std::move(run.trace));
  }
  return out;
}

const metrics::RendererResult* ran(const GoalRuns& runs, const std::string& label) {
  for (const metrics::RendererResult& result : runs.results)
    if (result.label == label && result.status == metrics::RunStatus::kOk) return &result;
  return nullptr;
}

Result<std::vector<GoalRuns>> run_on_shapes(const GoalBench& bench) {
  const std::string points = bench.quick ? "4000" : "40000";
  const std::string path =
      fmt::format("weave:frames={}:depth_mm=1:period_frames=300", bench.quick ? 2000 : 20000);
  const std::string renderers =
      "cloud,cloud-smooth,mesh-godobject:mesh=advancing-front:label=" + std::string(kMeshLabel);
  struct Shape {
    const char* name;
    std::string scene;
  };
  const Shape shapes[] = {
      {"a ring, points at random", "torus:sampling=random:seed=11:points=" + points},
      {"a ring, 30 times as dense on one side", "torus:sampling=random:density=30:seed=12:points=" + points},
      {"a relief, points at random", "relief:sampling=random:seed=13:points=" + points},
      {"a ring, a tenth of a spacing of noise", "torus:sampling=random:noise=0.1:seed=14:points=" + points}};
  std::vector<GoalRuns> all;
  for (const Shape& shape : shapes) {
    bench.suite.progress().set_prefix(std::string(shape.name) + ": ");
    const auto measure = [&]() -> Result<GoalRuns> {
      PALPATE_ASSIGN(const Stage stage, goal_stage(bench, shape.scene, path, ReferenceChoice::kAuto));
      return goal_runs(bench, stage, shape.name, renderers);
    };
    PALPATE_ASSIGN(GoalRuns runs, bench.suite.once<GoalRuns>(fmt::format("model-{}", all.size() + 1),
                                                             shape.scene, measure, {{}, shape.scene}));
    all.push_back(std::move(runs));
  }
  return all;
}

Result<std::vector<GoalRuns>> run_by_size(const GoalBench& bench) {
  const std::string path = fmt::format("weave:frames={}:seed=1", bench.quick ? 2000 : 20000);
  // All sizes use one surface in a scanner's raster, from which the mesh takes no time to make.
  const std::string renderers =
      "cloud,cloud-smooth,mesh-godobject:mesh=organised:label=" + std::string(kMeshLabel);
  const std::vector<std::string> sizes = bench.quick ? std::vector<std::string>{"2601", "10201"}
                                                     : std::vector<std::string>{"10201", "101761", "1002001"};
  std::vector<GoalRuns> all;
  for (const std::string& points : sizes) {
    bench.suite.progress().set_prefix(points + " points: ");
    const std::string scene = "sinusoid:mesh=false:points=" + points;
    const auto measure = [&]() -> Result<GoalRuns> {
      PALPATE_ASSIGN(const Stage stage, goal_stage(bench, scene, path, ReferenceChoice::kNone));
      return goal_runs(bench, stage, format_count(stage.scene.input.models.front().cloud->size()) + " points",
                       renderers);
    };
    PALPATE_ASSIGN(GoalRuns runs,
                   bench.suite.once<GoalRuns>(points + "-points", scene, measure, {{}, scene}));
    all.push_back(std::move(runs));
  }
  return all;
}

std::string number_or_dash(const std::optional<double>& value) {
  return value ? format_number(*value) : std::string(kMissingNumber);
}

std::vector<Series> lines_of(const std::vector<std::string>& labels) {
  const std::vector<LineStyle> styles = line_styles_of(labels);
  std::vector<Series> lines;
  for (std::size_t i = 0; i < labels.size(); ++i)
    lines.push_back({labels[i], styles[i].colour, {}, {}, styles[i].dash});
  return lines;
}

Chart growth_chart(const std::string& name, const std::string& counted, const std::string& caption) {
  Chart chart;
  chart.name = name;
  chart.title = "Mean of all frames by number of " + counted;
  chart.caption = caption;
  chart.x_label = counted;
  chart.y_label = "mean of all frames, µs";
  chart.log_x = chart.log_y = true;
  chart.style = Chart::Style::kMarkedLines;
  chart.extra = "set offsets graph 0.03, graph 0.03, graph 0.1, graph 0.1\n";
  return chart;
}

Chart bar_chart(const std::string& name, const std::string& title, const std::string& x_label,
                const std::string& caption, const std::vector<Bar>& bars) {
  constexpr double kMargin = 0.6;
  constexpr int kBarHeight = 26, kAxisHeight = 80;
  Chart chart;
  chart.name = name;
  chart.title = title;
  chart.caption = caption;
  chart.x_label = x_label;
  chart.style = Chart::Style::kBars;
  chart.height = kAxisHeight + kBarHeight * static_cast<int>(bars.size());
  std::vector<std::string> labels;
  for (const Bar& bar : bars) labels.push_back(bar.label);
  chart.series = lines_of(labels);
  std::string tics;
  for (std::size_t i = 0; i < bars.size(); ++i) {
    const double row = -static_cast<double>(i);
    // gnuplot reads labels as number formats.
    std::string label = bars[i].label;
    for (std::size_t at = 0; (at = label.find('%', at)) != std::string::npos; at += 2) label.insert(at, "%");
    tics += fmt::format("{}'{}' {}", tics.empty() ? "" : ", ", label, row);
    chart.series[i].x = {bars[i].value};
    chart.series[i].y = {row};
  }
  chart.extra = fmt::format("set ytics ({})\nset yrange [{}:{}]\nset xrange [0:*]\nunset key\n", tics,
                            -static_cast<double>(bars.size()) + 1.0 - kMargin, kMargin);
  return chart;
}

}  // namespace palpate::experiments
