#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/goals/goals.h"
#include "experiments/stability/stability.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

/// Share of the stiffness that the true surface bears; the renderer loses the rest.
constexpr double kShareOfTruth = 90.0;
constexpr double kPercentOfTruth = 100.0;
/// In just noticeable units: a smaller ripple is not felt.
constexpr double kNoticedRipple = 1.0;
constexpr const char* kTruthLabel = "truth";

struct Looped {
  std::string label;
  std::vector<StabilityPoint> limits;  ///< by rate
  std::vector<TaskResult> tasks;
  std::optional<LoopScores> scores;
};

struct GoalLoop {
  const Stage& stage;
  Bench bench;
  Places places;
  std::vector<double> rates;
};

Status find_limits(render::HapticRenderer& renderer, const GoalLoop& loop, Looped& out) {
  for (const double rate : loop.rates) {
    StabilityPoint point;
    point.renderer = out.label;
    point.hand = "released";
    point.varied = "rate";
    point.rate_hz = rate;
    PALPATE_TRY(find_largest_stable(renderer, scene_stiffness(loop.stage), {}, loop.bench, loop.places, point,
                                    [] {}));
    out.limits.push_back(std::move(point));
  }
  return Done{};
}

Result<Looped> loop_truth(const GoalLoop& loop) {
  TruthRenderer truth(*loop.stage.truth, scene_stiffness(loop.stage));
  Looped out{kTruthLabel, {}, {}, {}};
  PALPATE_TRY(find_limits(truth, loop, out));
  return out;
}

Result<Looped> loop_renderer(const GoalBench& bench, const GoalLoop& loop, const RendererRequest& request) {
  Looped out{request.label, {}, {}, {}};
  Progress& progress = bench.suite.progress();
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> made,
                 bench.registry.make(request.name, request.options));
  PALPATE_TRY(made->prepare(loop.stage.scene.input, {bench.threads, nullptr}));
  PALPATE_TRY(find_limits(*made, loop, out));
  GainRenderer felt(*made, 1.0);
  PALPATE_ASSIGN(out.tasks, do_tasks(felt, loop.stage, loop.bench, loop.places, [] {}));
  PALPATE_ASSIGN(out.scores, score_loop(felt, loop.stage, loop.bench, loop.places, progress, [] {}));
  return out;
}

const Looped* looped(const std::vector<Looped>& all, const std::string& label) {
  const auto at = std::find_if(all.begin(), all.end(), [&](const Looped& one) { return one.label == label; });
  return at == all.end() ? nullptr : &*at;
}

/// Smallest share over the rates, in percent of the truth's at the same rate.
std::optional<double> share_of_truth(const std::vector<Looped>& all, const std::string& label) {
  const Looped *one = looped(all, label), *truth = looped(all, kTruthLabel);
  if (one == nullptr || truth == nullptr || one->limits.size() != truth->limits.size()) return std::nullopt;
  std::optional<double> least;
  for (std::size_t i = 0; i < one->limits.size(); ++i) {
    const double most = truth->limits[i].largest_stable_n_per_mm;
    if (!(most > 0.0)) return std::nullopt;
    const double share = kPercentOfTruth * one->limits[i].largest_stable_n_per_mm / most;
    least = least ? std::min(*least, share) : share;
  }
  return least;
}

std::optional<double> unstable_tasks(const std::vector<Looped>& all, const std::string& label) {
  const Looped* one = looped(all, label);
  if (one == nullptr) return std::nullopt;
  return static_cast<double>(
      std::count_if(one->tasks.begin(), one->tasks.end(), [](const TaskResult& t) { return !t.stable; }));
}

std::optional<double> under_hand(const std::vector<Looped>& all, const std::string& label,
                                 std::optional<double> LoopScores::Side::*score) {
  const Looped* one = looped(all, label);
  return one != nullptr && one->scores ? one->scores->closed.*score : std::nullopt;
}

Chart stable_chart(const std::vector<Looped>& all) {
  Chart chart;
  chart.name = "goal-stable";
  chart.title = "Largest stable stiffness by rate of the servo";
  chart.caption =
      "A released device, pushed steadily. Grey: the true surface in the renderer's place. A line that lies "
      "on it loses nothing.";
  chart.x_label = "rate of the servo, Hz";
  chart.y_label = "N/mm";
  chart.log_y = true;
  chart.style = Chart::Style::kMarkedLines;
  chart.extra = "set offsets graph 0.05, graph 0.05, graph 0.1, graph 0.1\n";
  std::vector<std::string> labels;
  for (const Looped& one : all)
    if (one.label != kTruthLabel) labels.push_back(one.label);
  std::vector<Series> lines = lines_of(labels);
  auto next = lines.begin();
  for (const Looped& one : all) {
    Series line{one.label, "#999999", {}, {}, {}, one.label == kTruthLabel};
    if (!line.is_truth) line = std::move(*next++);
    for (const StabilityPoint& point : one.limits) {
      line.x.push_back(point.rate_hz);
      line.y.push_back(point.largest_stable_n_per_mm);
    }
    chart.series.push_back(std::move(line));
  }
  return chart;
}

Table loop_table(const std::vector<Looped>& all) {
  Table table;
  table.title = "In the loop";
  table.columns = {"renderer, at, Hz", "largest stable, N/mm", "swing above it, mm", "plane, linear, N/mm"};
  for (const Looped& one : all)
    for (const StabilityPoint& point : one.limits)
      table.rows.push_back(
          {{fmt::format("{}, {:g}", one.label, point.rate_hz)},
           {format_number(point.largest_stable_n_per_mm)},
           {point.unlimited ? std::string(kMissingNumber) : format_number(point.limit_cycle_mm)},
           {number_or_dash(point.theory_n_per_mm)}});
  return table;
}

Table hand_table(const std::vector<Looped>& all) {
  Table table;
  table.title = "The hand's way, against the way with the truth in the loop";
  table.columns = {"renderer, task", "off, RMS mm", "off, most mm", "energy given, mJ", "stable"};
  for (const Looped& one : all)
    for (const TaskResult& task : one.tasks)
      table.rows.push_back({{one.label + ", " + task.task},
                            {format_number(task.contour_rms_mm)},
                            {format_number(task.contour_max_mm)},
                            {format_number(task.generated_mj)},
                            {task.stable ? "yes" : "no", false, !task.stable}});
  return table;
}

Result<std::vector<Looped>> run_loops(const GoalBench& bench, const Stage& stage) {
  GoalLoop loop{stage, {}, {}, {}};
  PALPATE_ASSIGN(loop.bench, bench_of("omni", "hand"));
  PALPATE_ASSIGN(loop.places, places_on(stage));
  loop.rates = bench.quick ? std::vector<double>{1000.0} : std::vector<double>{500.0, 1000.0, 2000.0, 4000.0};
  PALPATE_ASSIGN(const std::vector<RendererRequest> requests,
                 parse_renderers("cloud,cloud-smooth,mesh-godobject:mesh=advancing-front:label=" +
                                     std::string(kMeshLabel),
                                 bench.registry));
  std::vector<Looped> all;
  PALPATE_ASSIGN(Looped truth, loop_truth(loop));
  all.push_back(std::move(truth));
  for (const RendererRequest& request : requests) {
    bench.suite.progress().report("in the loop: " + request.label, -1.0);
    PALPATE_ASSIGN(Looped one, loop_renderer(bench, loop, request));
    all.push_back(std::move(one));
  }
  return all;
}

}  // namespace

Goal stability_goal(const GoalBench& bench) {
  Goal goal{"stable", "A stable and high quality haptic experience",
            "the loop with device and hand rests where the true surface would let it rest, and forces are "
            "temperate and right."};
  goal.method = {
      "A simulated hand holds a simulated desktop device (mass, friction, encoder, bandwidth of the motors) "
      "over the ring. The stiffness is raised until the loop swings, with each renderer and with the true "
      "surface in its place. Then the hand presses, slides, taps, lets go and follows a path. No device and "
      "no person was measured."};
  const std::string scene =
      std::string("torus:sampling=random:seed=11:points=") + (bench.quick ? "4000" : "40000");
  const std::string path =
      fmt::format("weave:frames={}:depth_mm=1:period_frames=300:speed_mm_s=20", bench.quick ? 1500 : 6000);
  const Result<Stage> stage = goal_stage(bench, scene, path, ReferenceChoice::kAuto);
  const Result<std::vector<Looped>> all = stage ? run_loops(bench, *stage) : stage.error();
  if (!all) goal.notes.push_back("Not measured: " + all.error().message());
  const std::vector<Looped> none, &loops = all ? *all : none;
  for (const char* const judged : kJudged) {
    goal.findings.push_back(
        {fmt::format("{}, largest stable stiffness, of the true surface's, at worst", judged),
         share_of_truth(loops, judged), "%", kShareOfTruth, false,
         "the renderer takes little of what the loop bears", share_of_truth(loops, kMeshLabel)});
    goal.findings.push_back({fmt::format("{}, tasks of the hand that are not stable", judged),
                             unstable_tasks(loops, judged), "", 0.0, true, "none may swing",
                             unstable_tasks(loops, kMeshLabel)});
    goal.findings.push_back({fmt::format("{}, ripple after the motors, of what touch notices", judged),
                             under_hand(loops, judged, &LoopScores::Side::ripple_shown_ratio), "times",
                             kNoticedRipple, true, "forces are temperate",
                             under_hand(loops, kMeshLabel, &LoopScores::Side::ripple_shown_ratio)});
    goal.findings.push_back({fmt::format("{}, force error under the hand", judged),
                             under_hand(loops, judged, &LoopScores::Side::force_rms_percent), "%",
                             kHandTellsPercent, true, "less than a hand can tell",
                             under_hand(loops, kMeshLabel, &LoopScores::Side::force_rms_percent)});
  }
  goal.tables = {loop_table(loops), hand_table(loops)};
  goal.figures.push_back(draw(stable_chart(loops), bench.figures));
  return goal;
}

}  // namespace palpate::experiments
