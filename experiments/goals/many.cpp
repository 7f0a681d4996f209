#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include <palpate/replay.h>
#include <palpate/result.h>
#include "experiments/goals/goals.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

/// Spheres in a square lattice, spaced so that the HIP is free between them.
constexpr double kBallMm = 10.0, kApartMm = 14.0;
constexpr double kDeepMm = 0.5, kAboveMm = 1.0;
/// Allowed ratio of a frame near one of many models to a frame with one model, including the search for it.
constexpr double kMostTimes = 2.0;
/// Allowed distance from the crease: a twentieth of a sphere. Points are 0.3 mm apart, 1 mm with quick.
constexpr double kCreaseMm = 0.05 * kBallMm;

/// `count` spheres sharing one cloud.
Result<Stage> balls(const GoalBench& bench, std::size_t count) {
  const std::string scene = fmt::format("sphere:extent_mm={}:points={}", kBallMm, bench.quick ? 400 : 4000);
  PALPATE_ASSIGN(Stage stage,
                 goal_stage(bench, scene, "tap:frames=400:depth_mm=0.1", ReferenceChoice::kNone));
  std::vector<render::ModelInput>& models = stage.scene.input.models;
  const render::ModelInput one = models.front();
  const auto side = static_cast<std::size_t>(std::ceil(std::sqrt(static_cast<double>(count))));
  models.clear();
  for (std::size_t i = 0; i < count; ++i) {
    render::ModelInput model = one;
    model.name = fmt::format("ball {}", i + 1);
    model.world_from_model.translation_mm =
        Vec3{kApartMm * static_cast<double>(i % side), kApartMm * static_cast<double>(i / side), 0.0};
    models.push_back(std::move(model));
  }
  return stage;
}

/// A path over `visited` evenly spread spheres: down onto each top, along it, and up.
trace::ProbePath visit(const std::vector<render::ModelInput>& models, std::size_t visited, int frames_each) {
  trace::ProbePath path;
  path.name = fmt::format("onto the top of {} balls", visited);
  const double top = 0.5 * kBallMm;
  for (std::size_t k = 0; k < visited; ++k) {
    const Vec3 middle = models[k * models.size() / visited].world_from_model.translation_mm;
    for (int i = 0; i < frames_each; ++i) {
      // Half a turn from above to below and back; along x by a fifth of the sphere.
      const double share = (static_cast<double>(i) + 0.5) / static_cast<double>(frames_each);
      const double down = 0.5 * (1.0 - std::cos(2.0 * M_PI * share));
      const double height = top + kAboveMm - (kAboveMm + kDeepMm) * down;
      path.hip_mm.emplace_back(middle + Vec3{0.2 * kBallMm * (share - 0.5), 0.0, height});
      path.t_s.push_back(kTickS * static_cast<double>(path.hip_mm.size()));
    }
  }
  return path;
}

struct ManyRow {
  std::string label;
  std::size_t models = 0, visited = 0, felt = 0;
  double mean_us = 0.0, bytes = 0.0;
  std::ptrdiff_t longest_at = 0;  ///< index of the longest frame on its sphere; 0 arrives from another
  std::optional<double> median_us{}, longest_us{};  ///< over all frames, each its median over the passes
};

std::size_t models_felt(const trace::ForceTrace& trace) {
  std::set<std::int32_t> felt;
  for (const render::Frame& frame : trace.frames)
    if (frame.contact && frame.model >= 0) felt.insert(frame.model);
  return felt.size();
}

Result<std::vector<ManyRow>> many_rows(const GoalBench& bench, std::size_t count) {
  const std::size_t visited = std::min<std::size_t>(count, bench.quick ? 4 : 25);
  PALPATE_ASSIGN(Stage stage, balls(bench, count));
  const int frames_each = bench.quick ? 200 : 800;
  stage.path = visit(stage.scene.input.models, visited, frames_each);
  PALPATE_ASSIGN(const GoalRuns runs, goal_runs(bench, stage, fmt::format("{} balls", count),
                                                "cloud,cloud-smooth,mesh-godobject:mesh=original:label=" +
                                                    std::string(kMeshLabel)));
  std::vector<ManyRow> rows;
  for (std::size_t i = 0; i < runs.results.size(); ++i) {
    const metrics::RendererResult& result = runs.results[i];
    if (result.status != metrics::RunStatus::kOk || !result.frame_all || !result.prepare)
      return Error{result.label + ": " + result.reason};
    ManyRow row{result.label, count, visited, models_felt(runs.traces[i])};
    row.mean_us = result.frame_all->mean_us.value_or(0.0);
    row.bytes = static_cast<double>(result.prepare->bytes);
    row.median_us = result.frame_all->p50_us;
    row.longest_us = result.frame_all->max_us;
    const std::vector<std::int64_t>& times = runs.traces[i].frame_ns;
    const auto longest = std::max_element(times.begin(), times.end()) - times.begin();
    row.longest_at = longest % frames_each;
    rows.push_back(std::move(row));
  }
  return rows;
}

Result<double> both_at_once(const GoalBench& bench, const std::string& renderer, const Options& options) {
  PALPATE_ASSIGN(Stage stage, balls(bench, 2));
  std::vector<render::ModelInput>& models = stage.scene.input.models;
  // The overlapping spheres form a crease into which the HIP descends; both must hold it.
  models[1].world_from_model.translation_mm = Vec3{0.8 * kBallMm, 0.0, 0.0};
  const double half = 0.4 * kBallMm, radius = 0.5 * kBallMm;
  const double crease = std::sqrt(radius * radius - half * half);
  trace::ProbePath path;
  path.name = "down into the crease";
  constexpr int kSteps = 1000;
  for (int i = 0; i <= kSteps; ++i) {
    path.hip_mm.emplace_back(half, 0.0, crease + kAboveMm - (kAboveMm + kDeepMm) * i / kSteps);
    path.t_s.push_back(kTickS * (i + 1));
  }
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> made, bench.registry.make(renderer, options));
  PALPATE_TRY(made->prepare(stage.scene.input, {bench.threads, nullptr}));
  PALPATE_ASSIGN(const trace::ForceTrace trace, trace::replay(*made, path));
  // Distance of the god object from the crease, mm; it should be on it.
  return (trace.frames.back().god_object_mm - Vec3{half, 0.0, crease}).norm();
}

const ManyRow* row_of(const std::vector<ManyRow>& rows, const std::string& label, std::size_t models) {
  for (const ManyRow& row : rows)
    if (row.label == label && row.models == models) return &row;
  return nullptr;
}

Table many_table(const std::vector<ManyRow>& rows) {
  Table table;
  table.title = "Many models at once";
  table.columns = {"renderer, models",        "visited",    "felt",
                   "mean of all frames, µs",  "median, µs", "longest, µs",
                   "memory beside the points"};
  for (const ManyRow& row : rows)
    table.rows.push_back({{fmt::format("{}, {}", row.label, row.models)},
                          {format_count(row.visited)},
                          {format_count(row.felt), false, row.felt != row.visited},
                          {format_number(row.mean_us)},
                          {number_or_dash(row.median_us)},
                          {number_or_dash(row.longest_us)},
                          {format_bytes(row.bytes)}});
  table.notes = {
      "The median and the longest are of frames timed one by one, each the median over the passes; the mean "
      "is timed over whole stretches of frames."};
  table.bad_means = "not every ball that was visited was felt";
  return table;
}

Chart many_chart(const std::vector<ManyRow>& rows) {
  Chart chart = growth_chart("goal-many-models", "models",
                             "The probe goes over balls that are spread evenly among all of them.");
  std::vector<std::string> labels;
  for (const ManyRow& row : rows)
    if (std::find(labels.begin(), labels.end(), row.label) == labels.end()) labels.push_back(row.label);
  chart.series = lines_of(labels);
  for (Series& line : chart.series)
    for (const ManyRow& row : rows)
      if (row.label == line.label) {
        line.x.push_back(static_cast<double>(row.models));
        line.y.push_back(row.mean_us);
      }
  return chart;
}

/// Reports a frame longer than a tick and its position.
void describe_long_frame(const std::vector<ManyRow>& rows, const std::string& label, std::size_t count,
                         Goal& goal) {
  const ManyRow* row = row_of(rows, label, count);
  if (row == nullptr || !row->longest_us || *row->longest_us <= kTickUs) return;
  goal.short_of.push_back(
      fmt::format("{} among {} models: the longest frame that repeats takes {} µs, more than a tick. It is "
                  "frame {} on its ball; frame 0 goes there from the ball before, over all that lie between.",
                  label, count, format_number(*row->longest_us), row->longest_at));
}

std::vector<ManyRow> all_rows(const GoalBench& bench, const std::vector<std::size_t>& counts, Goal& goal) {
  std::vector<ManyRow> rows;
  for (const std::size_t count : counts) {
    bench.suite.progress().set_prefix(fmt::format("{} models: ", count));
    const Result<std::vector<ManyRow>> more = many_rows(bench, count);
    if (more)
      rows.insert(rows.end(), more->begin(), more->end());
    else
      goal.notes.push_back(fmt::format("{} models: {}", count, more.error().message()));
  }
  return rows;
}

/// Mean frame with the most models over that with one.
std::optional<double> times_of_one(const std::vector<ManyRow>& rows, const std::string& label,
                                   const std::vector<std::size_t>& counts) {
  const ManyRow *one = row_of(rows, label, counts.front()), *many = row_of(rows, label, counts.back());
  if (one == nullptr || many == nullptr || !(one->mean_us > 0.0)) return std::nullopt;
  return many->mean_us / one->mean_us;
}

std::optional<double> not_felt(const std::vector<ManyRow>& rows, const std::string& label,
                               std::size_t count) {
  const ManyRow* many = row_of(rows, label, count);
  if (many == nullptr) return std::nullopt;
  return static_cast<double>(many->visited) - static_cast<double>(many->felt);
}

std::optional<double> off_crease_mm(const GoalBench& bench, const std::string& renderer, bool is_mesh,
                                    Goal& goal) {
  Options options;
  if (is_mesh) options.set("mesh", "original");
  const Result<double> off = both_at_once(bench, renderer, options);
  if (off) return *off;
  goal.notes.push_back(fmt::format("{}, two balls at once: {}", renderer, off.error().message()));
  return std::nullopt;
}

}  // namespace

Goal many_models_goal(const GoalBench& bench) {
  Goal goal{"many-models", "Support for multiple models interacted with simultaneously",
            "any number of models may be there, as far as memory goes, and several may be touched at once."};
  goal.method = {
      "Balls in a lattice, a renderer for all of them together. The probe presses onto 25 that are spread "
      "over the lattice (as many as there are, where there are fewer). Then it comes down into the crease "
      "between two balls that overlap, and must be held by both."};
  const std::vector<std::size_t> counts =
      bench.quick ? std::vector<std::size_t>{1, 9} : std::vector<std::size_t>{1, 10, 100, 1000};
  const std::vector<ManyRow> rows = all_rows(bench, counts, goal);
  const std::size_t most = counts.back();
  const std::optional<double> mesh_crease = off_crease_mm(bench, "mesh-godobject", true, goal);
  for (const char* const judged : kJudged) {
    goal.findings.push_back({fmt::format("{}, balls visited among {} and not felt", judged, most),
                             not_felt(rows, judged, most), "", 0.0, true, "every one is there",
                             not_felt(rows, kMeshLabel, most)});
    goal.findings.push_back({fmt::format("{}, mean frame among {} models, of that with one", judged, most),
                             times_of_one(rows, judged, counts), "times", kMostTimes, true, "our own goal",
                             times_of_one(rows, kMeshLabel, counts)});
    goal.findings.push_back({fmt::format("{}, god object off the crease of two balls", judged),
                             off_crease_mm(bench, judged, false, goal), "mm", kCreaseMm, true,
                             "held by both at once", mesh_crease});
    describe_long_frame(rows, judged, most, goal);
  }
  goal.tables.push_back(many_table(rows));
  goal.figures.push_back(draw(many_chart(rows), bench.figures));
  return goal;
}

}  // namespace palpate::experiments
