#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <palpate/replay.h>
#include <palpate/result.h>
#include "experiments/goals/measures.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr double kPercentOfOne = 100.0;

// Coefficients of the plane's points rise along x, by a quarter of their range and more over the path.
constexpr double kPlaneMm = 60.0;
constexpr double kLeastStiffness = 0.3, kMostStiffness = 0.7;
constexpr double kLeastFriction = 0.1, kMostFriction = 0.5;
/// Initial part of the path left out: the friction spring is still stretching (stick).
constexpr double kSticksMm = 2.0;

double between(double least, double most, double x_mm) {
  return least + (most - least) * (x_mm / kPlaneMm + 0.5);
}

void give_properties(render::ModelInput& model) {
  auto properties = std::make_shared<surface::PointProperties>();
  for (std::size_t i = 0; i < model.cloud->size(); ++i) {
    const double x = model.cloud->point_mm(i).x();
    properties->stiffness_n_per_mm.push_back(static_cast<float>(between(kLeastStiffness, kMostStiffness, x)));
    const auto friction = static_cast<float>(between(kLeastFriction, kMostFriction, x));
    properties->static_friction.push_back(friction);
    properties->dynamic_friction.push_back(friction);
  }
  model.surface.per_point = properties;
}

/// RMS errors of rendered coefficients, in percent of those of the points at the place.
struct CarriedOff {
  double stiffness_percent = 0.0, friction_percent = 0.0;
  std::uint64_t frames = 0;
};
CarriedOff carried_by(const trace::ProbePath& path, const trace::ForceTrace& trace) {
  CarriedOff carried;
  double travel_mm = 0.0;
  for (std::size_t k = 1; k < path.size(); ++k) {
    const render::Frame& frame = trace.frames[k];
    if (!frame.contact) {
      travel_mm = 0.0;
      continue;
    }
    travel_mm += (path.hip_mm[k] - path.hip_mm[k - 1]).norm();
    const Vec3 spring = frame.god_object_mm - path.hip_mm[k];
    const double normal_n = frame.force_n.z();
    if (travel_mm < kSticksMm || !(spring.norm() > 0.0) || !(normal_n > 0.0)) continue;
    const double x = frame.god_object_mm.x();
    const double stiffness = frame.force_n.norm() / spring.norm();
    const double friction = std::hypot(frame.force_n.x(), frame.force_n.y()) / normal_n;
    const double stiffness_off = stiffness / between(kLeastStiffness, kMostStiffness, x) - 1.0;
    const double friction_off = friction / between(kLeastFriction, kMostFriction, x) - 1.0;
    carried.stiffness_percent += stiffness_off * stiffness_off;
    carried.friction_percent += friction_off * friction_off;
    ++carried.frames;
  }
  if (carried.frames == 0) return carried;
  const auto mean = [&](double sum) {
    return kPercentOfOne * std::sqrt(sum / static_cast<double>(carried.frames));
  };
  carried.stiffness_percent = mean(carried.stiffness_percent);
  carried.friction_percent = mean(carried.friction_percent);
  return carried;
}

Result<CarriedOff> feel_plane(const GoalBench& bench, const std::string& renderer) {
  const std::string scene =
      fmt::format("plane:extent_mm={}:spacing_mm={}", kPlaneMm, bench.quick ? 1.0 : 0.25);
  const std::string path =
      fmt::format("slide:frames={}:depth_mm=1:speed_mm_s=20:u=0.1:v=0.5", bench.quick ? 2500 : 10'000);
  PALPATE_ASSIGN(Stage stage, goal_stage(bench, scene, path, ReferenceChoice::kNone));
  give_properties(stage.scene.input.models.front());
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> made, bench.registry.make(renderer, {}));
  PALPATE_TRY(made->prepare(stage.scene.input, {bench.threads, nullptr}));
  PALPATE_ASSIGN(const trace::ForceTrace trace, trace::replay(*made, stage.path));
  return carried_by(stage.path, trace);
}

std::optional<double> rms_percent(const GoalRuns& runs, const std::string& label) {
  const metrics::RendererResult* result = ran(runs, label);
  return result != nullptr && result->accuracy ? result->accuracy->force_rms_percent : std::nullopt;
}

std::optional<double> wrong_frames(const GoalRuns& runs, const std::string& label) {
  const metrics::RendererResult* result = ran(runs, label);
  if (result == nullptr || !result->accuracy) return std::nullopt;
  return static_cast<double>(result->accuracy->missed_contact_frames +
                             result->accuracy->false_contact_frames);
}

Table shapes_table(const std::vector<GoalRuns>& shapes) {
  Table table;
  table.title = "Geometry: against the true surface";
  table.columns = {"model, renderer", "points",           "force error, RMS %", "median %",
                   "within 7 %, %",   "direction p99, °", "missed or false",    "jump error, most N"};
  for (const GoalRuns& runs : shapes) {
    table.rows.push_back({{runs.name}});
    for (const metrics::RendererResult& result : runs.results) {
      if (result.status != metrics::RunStatus::kOk || !result.accuracy) {
        std::vector<Cell> row(table.columns.size(), Cell{kMissingNumber});
        row.front() = {result.label + ": " + result.reason, false, true};
        table.rows.push_back(std::move(row));
        continue;
      }
      const metrics::Accuracy& a = *result.accuracy;
      table.rows.push_back({{result.label},
                            {format_count(runs.points)},
                            {number_or_dash(a.force_rms_percent)},
                            {number_or_dash(a.force_p50_percent)},
                            {number_or_dash(a.within_7_percent)},
                            {number_or_dash(a.direction_p99_deg)},
                            {number_or_dash(wrong_frames(runs, result.label))},
                            {number_or_dash(a.jump_error_max_n)}});
    }
  }
  table.bad_means = "did not run to its end";
  return table;
}

}  // namespace

Goal fidelity_goal(const GoalBench& bench, const std::vector<GoalRuns>& shapes) {
  Goal goal{
      "fidelity", "High fidelity",
      "everything that the points hold is to be felt: the shape that they lie on, and the properties that "
      "each of them carries."};
  goal.method = {
      "Geometry: one path over a model that is known by its formula, through each renderer; forces are "
      "compared with those of the formula. Contact that is missed or false by more than the local resolution "
      "is counted.",
      "Properties: a plane whose points carry a stiffness and a friction that rise along it. The probe "
      "slides over it; what is felt at a place is divided by what the points carry there."};
  for (const char* const judged : kJudged) {
    for (const GoalRuns& runs : shapes) {
      goal.findings.push_back({fmt::format("{}, force error on {}", judged, runs.name),
                               rms_percent(runs, judged), "%", kHandTellsPercent, true,
                               "less than a hand can tell", rms_percent(runs, kMeshLabel)});
    }
    std::optional<double> wrong = 0.0, mesh = 0.0;
    for (const GoalRuns& runs : shapes) {
      const std::optional<double> here = wrong_frames(runs, judged), there = wrong_frames(runs, kMeshLabel);
      wrong = wrong && here ? std::optional(*wrong + *here) : std::nullopt;
      mesh = mesh && there ? std::optional(*mesh + *there) : std::nullopt;
    }
    goal.findings.push_back({fmt::format("{}, frames of missed or false contact on all of them", judged),
                             wrong, "", 0.0, true, "contact beyond one resolution is never wrong", mesh});
    const Result<CarriedOff> carried = feel_plane(bench, judged);
    if (!carried) goal.notes.push_back(fmt::format("{}: {}", judged, carried.error().message()));
    const bool any = carried && carried->frames > 0;
    goal.findings.push_back({fmt::format("{}, stiffness by point, off by", judged),
                             any ? std::optional(carried->stiffness_percent) : std::nullopt, "%",
                             kHandTellsPercent, true, "less than a hand can tell"});
    goal.findings.push_back({fmt::format("{}, friction by point, off by", judged),
                             any ? std::optional(carried->friction_percent) : std::nullopt, "%",
                             kHandTellsPercent, true, "less than a hand can tell"});
  }
  goal.notes.emplace_back(
      "The mesh renderer has no properties by point: those rows have no mesh beside them.");
  goal.tables.push_back(shapes_table(shapes));
  std::vector<Bar> bars;
  for (const GoalRuns& runs : shapes)
    for (const metrics::RendererResult& result : runs.results)
      if (const std::optional<double> rms = rms_percent(runs, result.label))
        bars.push_back({fmt::format("{}: {}", runs.name, result.label), *rms});
  goal.figures.push_back(draw(bar_chart("goal-fidelity", "Force error against the true surface",
                                        "root mean square, % of the true force",
                                        "Short is good. The colours are those of the bars' own names.", bars),
                              bench.figures));
  goal.figures.back().wide = true;
  return goal;
}

}  // namespace palpate::experiments
