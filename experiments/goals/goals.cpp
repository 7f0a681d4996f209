#include "experiments/goals/goals.h"

#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/goals/measures.h"

namespace palpate::experiments {
namespace {

constexpr const char* kGoalsFolder = "out/goals";

/// Runs shared by several pages; on failure these pages state missing numbers.
std::vector<GoalRuns> shared_runs(Result<std::vector<GoalRuns>> runs, const std::string& what,
                                  GoalsDocument& document) {
  if (runs) return *std::move(runs);
  document.warnings.push_back(fmt::format("{} could not be run: {}", what, runs.error().message()));
  return {};
}

/// A goal that no run of others serves: measured once, unless a number of it is missing.
Status add_goal(const GoalBench& bench, const std::string& id, Goal (*measure)(const GoalBench&),
                GoalsDocument& document) {
  Goal& goal = document.goals.emplace_back();
  if (bench.suite.take(id, id, goal)) return Done{};
  bench.suite.folder().start_part();
  goal = measure(bench);
  return verdict_of(goal) == Verdict::kNotMeasured ? Status(Done{}) : bench.suite.keep(id, id, goal);
}

Status measure_goals(const GoalBench& bench, GoalsDocument& document) {
  ProgressBar& progress = bench.suite.progress();
  // Runs first, before the program starts other processes.
  const std::vector<GoalRuns> shapes = shared_runs(run_on_shapes(bench), "The models", document);
  const std::vector<GoalRuns> sizes = shared_runs(run_by_size(bench), "The sizes", document);
  progress.set_prefix("");
  document.goals.push_back(fidelity_goal(bench, shapes));
  document.goals.push_back(no_mesh_goal(bench, shapes));
  progress.set_prefix("one machine: ");
  PALPATE_TRY(add_goal(bench, "one-machine", one_machine_goal, document));
  progress.set_prefix("");
  document.goals.push_back(worst_case_goal(bench, shapes, sizes));
  document.goals.push_back(size_goal(bench, sizes));
  progress.set_prefix("the closed loop: ");
  PALPATE_TRY(add_goal(bench, "stable", stability_goal, document));
  PALPATE_TRY(add_goal(bench, "many-models", many_models_goal, document));
  progress.set_prefix("");
  return Done{};
}

}  // namespace

Result<int> run_goals(const GoalsArguments& arguments, Context& context) {
  Suite suite(context);
  PALPATE_TRY(suite.open(arguments.out.empty() ? kGoalsFolder : arguments.out));
  const render::Registry registry = all_renderers();
  PALPATE_TRY(suite.begin(RunKey()
                              .add("goals")
                              .add(std::uint64_t{arguments.quick})
                              .add(static_cast<std::uint64_t>(arguments.threads))));
  GoalsDocument document;
  document.head = new_head(context.command_line);
  document.quick = arguments.quick;
  if (arguments.quick)
    document.warnings.emplace_back(
        "A quick run: small models and short paths, a trial of the machinery. Its numbers are no "
        "measurement.");
  PALPATE_ASSIGN(const OutputFolder figures, suite.folder().inside("figures"));
  PALPATE_TRY(measure_goals({registry, suite, figures, arguments.quick, arguments.threads}, document));
  suite.progress().report("drawing the pages", -1.0);
  PALPATE_TRY(write_goal_pages(document, suite.folder()));
  PALPATE_TRY(suite.publish({kGoalsFile, to_json(document), {goals_table(document)}, document.warnings},
                            goals_page(document), arguments.json));
  const bool all = std::none_of(document.goals.begin(), document.goals.end(),
                                [](const Goal& goal) { return verdict_of(goal) == Verdict::kNotMeasured; });
  return all ? kExitOk : kExitFellShort;
}

}  // namespace palpate::experiments
