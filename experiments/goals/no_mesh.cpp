#include <fmt/format.h>

#include "experiments/goals/measures.h"
#include "toolkit/core/numbers.h"

namespace palpate::experiments {
namespace {

constexpr double kAll = 100.0;

/// Of one model: what preparation took and holds, in percent of the mesh's.
struct Share {
  std::optional<double> time_percent, bytes_percent;
};
Share share_of(const GoalRuns& runs, const std::string& label) {
  const metrics::RendererResult *ours = ran(runs, label), *mesh = ran(runs, kMeshLabel);
  if (ours == nullptr || mesh == nullptr || !ours->prepare || !mesh->prepare) return {};
  Share share;
  if (mesh->prepare->total_ms > 0.0)
    share.time_percent = kAll * ours->prepare->total_ms / mesh->prepare->total_ms;
  if (mesh->prepare->bytes > 0)
    share.bytes_percent =
        kAll * static_cast<double>(ours->prepare->bytes) / static_cast<double>(mesh->prepare->bytes);
  return share;
}

/// Phases that make one mesh of all points.
double meshing_phases(const metrics::RendererResult& result) {
  double count = 0.0;
  for (const render::PreparePhase& phase : result.prepare->phases)
    for (const char* const word : {"mesh", "reconstruct", "triangulat", "advancing", "poisson"})
      if (phase.name.find(word) != std::string::npos) {
        ++count;
        break;
      }
  return count;
}

/// What each builds, phase by phase.
Table phases_table(const GoalRuns& runs) {
  Table table;
  table.title = "What is made before the first frame: " + runs.name;
  table.columns = {"renderer", "ready after", "bytes a point", "phases"};
  for (const metrics::RendererResult& result : runs.results) {
    if (result.status != metrics::RunStatus::kOk || !result.prepare) continue;
    std::string phases;
    for (const render::PreparePhase& phase : result.prepare->phases)
      phases += fmt::format("{}{} {}", phases.empty() ? "" : ", ", phase.name, duration_text(phase.ms));
    table.rows.push_back({{result.label},
                          {duration_text(result.prepare->total_ms)},
                          {short_number(static_cast<double>(result.prepare->bytes) /
                                        static_cast<double>(std::max<std::uint64_t>(1, runs.points)))},
                          {phases}});
  }
  return table;
}

Table decisions_table(const GoalRuns& runs) {
  Table table;
  table.title = "What is held, and why";
  table.columns = {"renderer, about", "choice", "reason"};
  for (const char* const judged : kJudged) {
    const metrics::RendererResult* result = ran(runs, judged);
    if (result == nullptr || !result->prepare || result->prepare->decisions.models.empty()) continue;
    table.rows.push_back({{std::string(judged)}});
    for (const render::Decision& decision : result->prepare->decisions.models.front().decisions)
      table.rows.push_back({{decision.about}, {decision.choice}, {decision.reason}});
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
      "front "
      "first. What each builds is what its own report of the preparation names, phase by phase."};
  std::vector<Bar> bars;
  for (const char* const judged : kJudged) {
    double most = 0.0, mesh_phases = 0.0;
    bool all = !shapes.empty();
    std::optional<double> slowest = 0.0, largest = 0.0;
    for (const GoalRuns& runs : shapes) {
      const metrics::RendererResult *ours = ran(runs, judged), *mesh = ran(runs, kMeshLabel);
      all = all && ours != nullptr && ours->prepare;
      if (ours != nullptr && ours->prepare) most = std::max(most, meshing_phases(*ours));
      if (mesh != nullptr && mesh->prepare) mesh_phases = std::max(mesh_phases, meshing_phases(*mesh));
      const Share share = share_of(runs, judged);
      slowest = slowest && share.time_percent ? std::optional(std::max(*slowest, *share.time_percent))
                                              : std::nullopt;
      largest = largest && share.bytes_percent ? std::optional(std::max(*largest, *share.bytes_percent))
                                               : std::nullopt;
    }
    goal.findings.push_back({fmt::format("{}, steps of preparation that make a mesh", judged),
                             all ? std::optional(most) : std::nullopt, "", 0.0, true, "none is to be made",
                             mesh_phases});
    goal.findings.push_back({fmt::format("{}, ready after, of the mesh's time, at worst", judged), slowest,
                             "%", kAll, true, "what makes no mesh should not take longer", kAll});
    goal.findings.push_back({fmt::format("{}, memory, of the mesh's, at worst", judged), largest, "%", kAll,
                             true, "nor hold more", kAll});
  }
  if (!shapes.empty()) {
    for (const metrics::RendererResult& result : shapes.front().results)
      if (result.status == metrics::RunStatus::kOk && result.prepare)
        bars.push_back({result.label, result.prepare->total_ms});
    goal.tables.push_back(phases_table(shapes.front()));
    goal.tables.push_back(decisions_table(shapes.front()));
  }
  goal.figures.push_back(draw(bar_chart("goal-no-reconstruction", "From points to the first frame", "ms",
                                        "Everything before the first frame, on the first model.", bars),
                              bench.figures));
  goal.short_of.emplace_back(
      "What is deduced is kept, for speed: cloud holds for each point the triangles that it spans with its "
      "neighbours, cloud-smooth local patches in bricks. No two points have to agree on them, so they are no "
      "mesh; but they are not deduced anew in each frame either.");
  return goal;
}

}  // namespace palpate::experiments
