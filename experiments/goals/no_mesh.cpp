#include <fmt/format.h>

#include "experiments/goals/measures.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
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
