#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <palpate/replay.h>
#include <palpate/result.h>
#include "experiments/goals/goals.h"
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

namespace {

constexpr double kAllPercent = 100.0;

/// Number of models rendered from something other than points, by the renderer's declaration.
std::optional<double> not_as_points(const std::vector<GoalRuns>& shapes, const std::string& label) {
  double count = 0.0;
  for (const GoalRuns& runs : shapes) {
    const metrics::RendererResult* result = ran(runs, label);
    if (result == nullptr) return std::nullopt;
    if (result->works_on != render::Geometry::kPoints) ++count;
  }
  return shapes.empty() ? std::nullopt : std::optional(count);
}

/// Reports stored data beyond the points themselves.
void describe_kept(const std::vector<GoalRuns>& shapes, const std::string& label, Goal& goal) {
  // Three floats.
  constexpr double kPointBytes = 12.0;
  double most = 0.0;
  for (const GoalRuns& runs : shapes)
    if (const metrics::RendererResult* result = ran(runs, label);
        result != nullptr && result->prepare && runs.points > 0)
      most = std::max(most, static_cast<double>(result->prepare->bytes) / static_cast<double>(runs.points));
  if (most > kPointBytes)
    goal.short_of.push_back(
        fmt::format("{} keeps what it deduces of each place, for speed: up to {} bytes a point beside the {} "
                    "of the point itself.",
                    label, format_number(most), format_number(kPointBytes)));
}

/// Preparation time and memory, in percent of the mesh's.
struct Shares {
  std::optional<double> slowest_percent, largest_percent;
};
/// The worst over all models; empty if one did not run.
Shares worst_shares(const std::vector<GoalRuns>& shapes, const std::string& label) {
  Shares worst;
  for (const GoalRuns& runs : shapes) {
    const metrics::RendererResult *ours = ran(runs, label), *mesh = ran(runs, kMeshLabel);
    if (ours == nullptr || mesh == nullptr || !ours->prepare || !mesh->prepare) return {};
    const render::PrepareReport &own = *ours->prepare, &theirs = *mesh->prepare;
    if (!(theirs.total_ms > 0.0) || theirs.bytes == 0) return {};
    const double bytes = static_cast<double>(own.bytes) / static_cast<double>(theirs.bytes);
    worst.slowest_percent =
        std::max(worst.slowest_percent.value_or(0.0), kAllPercent * own.total_ms / theirs.total_ms);
    worst.largest_percent = std::max(worst.largest_percent.value_or(0.0), kAllPercent * bytes);
  }
  return worst;
}

Table phases_table(const GoalRuns& runs) {
  Table table;
  table.title = "Preparation before the first frame: " + runs.name;
  table.columns = {"renderer", "ready after", "bytes a point", "phases"};
  for (const metrics::RendererResult& result : runs.results) {
    if (result.status != metrics::RunStatus::kOk || !result.prepare) continue;
    std::string phases;
    for (const render::PreparePhase& phase : result.prepare->phases)
      phases += fmt::format("{}{} {}", phases.empty() ? "" : ", ", phase.name, format_duration(phase.ms));
    table.rows.push_back({{result.label},
                          {format_duration(result.prepare->total_ms)},
                          {format_number(static_cast<double>(result.prepare->bytes) /
                                         static_cast<double>(std::max<std::uint64_t>(1, runs.points)))},
                          {phases}});
  }
  return table;
}

}  // namespace

Goal no_mesh_goal(const GoalBench& bench, const std::vector<GoalRuns>& shapes) {
  Goal goal{
      "no-reconstruction", "No explicit surface reconstruction",
      "what is known of the surface is deduced from points near each other, when it is asked for; no mesh "
      "of the whole is made first."};
  goal.method = {
      "The same points are prepared for each renderer; the mesh renderer's are triangulated by advancing "
      "front first. What a renderer works on is what it declares; what it builds is what its own report of "
      "the preparation names, phase by phase. No two points have to agree on what is deduced at each of "
      "them."};
  std::vector<Bar> bars;
  for (const char* const judged : kJudged) {
    const Shares worst = worst_shares(shapes, judged);
    goal.findings.push_back({fmt::format("{}, models that it does not feel as points", judged),
                             not_as_points(shapes, judged), "", 0.0, true, "no mesh is to be made of any",
                             not_as_points(shapes, kMeshLabel)});
    goal.findings.push_back({fmt::format("{}, ready after, of the mesh's time, at worst", judged),
                             worst.slowest_percent, "%", kAllPercent, true,
                             "what makes no mesh should not take longer", kAllPercent});
    goal.findings.push_back({fmt::format("{}, memory, of the mesh's, at worst", judged),
                             worst.largest_percent, "%", kAllPercent, true, "nor hold more", kAllPercent});
    describe_kept(shapes, judged, goal);
  }
  if (!shapes.empty()) {
    for (const metrics::RendererResult& result : shapes.front().results)
      if (result.status == metrics::RunStatus::kOk && result.prepare)
        bars.push_back({result.label, result.prepare->total_ms});
    goal.tables.push_back(phases_table(shapes.front()));
  }
  goal.figures.push_back(draw(bar_chart("goal-no-reconstruction", "From points to the first frame", "ms",
                                        "Everything before the first frame, on the first model.", bars),
                              bench.figures));
  return goal;
}

}  // namespace palpate::experiments
