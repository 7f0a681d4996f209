#include "experiments/goals/goals.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>

#include "experiments/goals/measures.h"
#include "experiments/session/run_key.h"
#include "experiments/session/terminal.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/try.h"

namespace palpate::experiments {
namespace {

constexpr const char* kGoalsFolder = "out/goals";

/// Runs that several pages share; one that fails leaves its pages without numbers, which they say.
std::vector<GoalRuns> shared_runs(Result<std::vector<GoalRuns>> runs, const std::string& what,
                                  GoalsDocument& document) {
  if (runs) return *std::move(runs);
  document.warnings.push_back(fmt::format("{} could not be run: {}", what, runs.error().message()));
  return {};
}

void measure_goals(const GoalBench& bench, GoalsDocument& document) {
  ProgressBar& progress = bench.context.progress;
  // First of all, before other processes of this program are about.
  progress.set_prefix("one machine: ");
  Goal one_machine = one_machine_goal(bench);
  const std::vector<GoalRuns> shapes = shared_runs(run_on_shapes(bench), "The models", document);
  const std::vector<GoalRuns> sizes = shared_runs(run_by_size(bench), "The sizes", document);
  progress.set_prefix("");
  document.goals.push_back(fidelity_goal(bench, shapes));
  document.goals.push_back(no_mesh_goal(bench, shapes));
  document.goals.push_back(std::move(one_machine));
  document.goals.push_back(worst_case_goal(bench, shapes, sizes));
  document.goals.push_back(size_goal(bench, sizes));
  progress.set_prefix("the closed loop: ");
  document.goals.push_back(stability_goal(bench));
  document.goals.push_back(many_models_goal(bench));
  progress.set_prefix("");
}

Status measure_into(const OutputFolder& folder, const render::Registry& registry,
                    const GoalsArguments& arguments, Context& context, GoalsDocument& document) {
  PALPATE_ASSIGN(const OutputFolder figures, folder.inside("figures"));
  measure_goals({registry, context, figures, arguments.quick, arguments.threads}, document);
  context.progress.report("drawing the pages", -1.0);
  PALPATE_TRY(write_goals(document, folder));
  return folder.complete();
}

}  // namespace

int run_goals(const GoalsArguments& arguments, Context& context) {
  const Result<OutputFolder> folder =
      OutputFolder::open(arguments.out.empty() ? kGoalsFolder : arguments.out);
  if (!folder) return fail(folder.error(), kExitBadInput);
  const render::Registry registry = all_renderers();
  RunKey key;
  key.add("goals").add(std::uint64_t{arguments.quick});
  if (const Status begun = begin_run(*folder, key.word(), context); !begun)
    return fail(begun.error(), kExitFellShort, &context.progress);
  GoalsDocument document;
  document.head = new_head(context.command_line);
  document.quick = arguments.quick;
  if (arguments.quick)
    document.warnings.emplace_back(
        "A quick run: small models and short paths, a trial of the machinery. Its numbers are no "
        "measurement.");
  if (const Status done = measure_into(*folder, registry, arguments, context, document); !done)
    return fail(done.error(), kExitFellShort, &context.progress);
  context.progress.clear();
  if (arguments.json)
    fmt::print("{}", to_json(document));
  else
    fmt::print("{}\nreport: {}\n", to_text(goals_table(document), terminal_columns(STDOUT_FILENO)),
               std::filesystem::absolute(folder->file(kReportFile)).string());
  std::fflush(stdout);
  for (const std::string& warning : document.warnings) tell("palpate: warning: {}\n", warning);
  const bool all = std::none_of(document.goals.begin(), document.goals.end(),
                                [](const Goal& goal) { return verdict_of(goal) == Verdict::kNotMeasured; });
  return all ? kExitOk : kExitFellShort;
}

}  // namespace palpate::experiments
