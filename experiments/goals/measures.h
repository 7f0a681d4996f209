// What the pages of the goals are made of: one measurement each, some of which serve several goals.
#pragma once

#include <string>
#include <vector>

#include "experiments/goals/goal.h"
#include "experiments/goals/tick.h"
#include "experiments/run/run.h"
#include "experiments/session/session.h"
#include "toolkit/trace/trace.h"

namespace palpate::experiments {

/// What all measurements share. Refers to all it is given.
struct GoalBench {
  const render::Registry& registry;
  Context& context;
  const OutputFolder& figures;
  bool quick = false;  ///< small models and short paths: a trial of the machinery, no measurement
  int threads = 0;     ///< of preparation; 0: all
};

/// Some renderers on one stage. The mesh is the last.
struct GoalRuns {
  std::string name;  ///< of the model, for a reader
  std::uint64_t points = 0;
  std::vector<metrics::RendererResult> results;
  std::vector<trace::ForceTrace> traces{};  ///< of each result; empty where it failed
};
/// Renderers of ours that are judged, and the mesh beside them.
inline constexpr const char* kJudged[] = {"cloud", "cloud-smooth"};
inline constexpr const char* kMeshLabel = "mesh";

/// A scene as `palpate compare` takes it, ready to run on.
[[nodiscard]] Result<Stage> goal_stage(const GoalBench& bench, const std::string& scene,
                                       const std::string& path, ReferenceChoice reference);
/// `renderers`: as on the command line.
[[nodiscard]] Result<GoalRuns> goal_runs(const GoalBench& bench, const Stage& stage, const std::string& name,
                                         const std::string& renderers);
/// The result of this label; null where it has not run to its end.
[[nodiscard]] const metrics::RendererResult* ran(const GoalRuns& runs, const std::string& label);

/// Models of every kind of points, with a truth.
[[nodiscard]] Result<std::vector<GoalRuns>> run_on_shapes(const GoalBench& bench);
/// One surface and path by number of points.
[[nodiscard]] Result<std::vector<GoalRuns>> run_by_size(const GoalBench& bench);

// Each fills a goal that has its id and words.
[[nodiscard]] Goal fidelity_goal(const GoalBench& bench, const std::vector<GoalRuns>& shapes);
[[nodiscard]] Goal no_mesh_goal(const GoalBench& bench, const std::vector<GoalRuns>& shapes);
[[nodiscard]] Goal one_machine_goal(const GoalBench& bench);
[[nodiscard]] Goal worst_case_goal(const GoalBench& bench, const std::vector<GoalRuns>& shapes,
                                   const std::vector<GoalRuns>& sizes);
[[nodiscard]] Goal size_goal(const GoalBench& bench, const std::vector<GoalRuns>& sizes);
[[nodiscard]] Goal stability_goal(const GoalBench& bench);
[[nodiscard]] Goal many_models_goal(const GoalBench& bench);

/// Lying bars, one a label.
struct Bar {
  std::string label;
  double value = 0.0;
};
[[nodiscard]] Chart bar_chart(const std::string& name, const std::string& title, const std::string& x_label,
                              const std::string& caption, const std::vector<Bar>& bars);

/// An empty chart of the mean of all frames against a count, both axes logarithmic.
[[nodiscard]] Chart growth_chart(const std::string& name, const std::string& counted,
                                 const std::string& caption);

}  // namespace palpate::experiments
