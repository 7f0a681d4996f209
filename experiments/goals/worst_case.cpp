#include <fmt/format.h>

#include <algorithm>

#include "experiments/goals/goals.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

using GoalStatistics = std::optional<double> trace::FrameStatistics::*;

/// The largest over all models; empty if one did not run.
std::optional<double> largest_over(const std::vector<const GoalRuns*>& all, const std::string& label,
                                   GoalStatistics member) {
  std::optional<double> most = 0.0;
  for (const GoalRuns* runs : all) {
    const metrics::RendererResult* result = ran(*runs, label);
    const bool known = most && result != nullptr && result->frame_all && (*result->frame_all).*member;
    most = known ? std::optional(std::max(*most, *((*result->frame_all).*member))) : std::nullopt;
  }
  return most;
}

std::optional<double> misses(const std::vector<const GoalRuns*>& all, const std::string& label) {
  double sum = 0.0;
  for (const GoalRuns* runs : all) {
    const metrics::RendererResult* result = ran(*runs, label);
    if (result == nullptr || !result->frame_all) return std::nullopt;
    sum += static_cast<double>(result->frame_all->deadline_misses_1khz);
  }
  return all.empty() ? std::nullopt : std::optional(sum);
}

/// A single reading above a tick that does not repeat is due to the machine, but the servo still misses that
/// tick.
void describe_longest_reading(const std::vector<const GoalRuns*>& all, const std::string& label, Goal& goal) {
  const std::optional<double> longest = largest_over(all, label, &trace::FrameStatistics::worst_us);
  if (longest && *longest > kTickUs)
    goal.short_of.push_back(fmt::format(
        "{}: the longest single reading is {} µs, more than a tick. It holds what the system did meanwhile, "
        "which gives no promise.",
        label, format_number(*longest)));
}

Table goal_frames_table(const std::vector<const GoalRuns*>& all) {
  Table table;
  table.title = "All frames, µs";
  table.columns = {"model, renderer",        "mean",         "99.9 % under", "longest that repeats",
                   "longest single reading", "at the bound", "over 1 ms"};
  for (const GoalRuns* runs : all) {
    table.rows.push_back({{runs->name}});
    for (const metrics::RendererResult& result : runs->results) {
      if (result.status != metrics::RunStatus::kOk || !result.frame_all) continue;
      const trace::FrameStatistics& frame = *result.frame_all;
      table.rows.push_back({{result.label},
                            {number_or_dash(frame.mean_us)},
                            {number_or_dash(frame.p999_us)},
                            {number_or_dash(frame.max_us)},
                            {number_or_dash(frame.worst_us)},
                            {format_count(frame.bound_hits)},
                            {format_count(frame.deadline_misses_1khz)}});
    }
  }
  table.notes = {
      "The longest frame that repeats is that of the frames' medians over the passes: the renderer's own. "
      "The longest single reading holds what else ran on the machine.",
      "At the bound: frames that reached the written bound on their work and went on in the next one."};
  return table;
}

Table bounds_table(const GoalBench& bench) {
  Table table;
  table.title = "The written bound on a frame's work";
  table.columns = {"renderer", "bound"};
  for (const char* const name : {"cloud", "cloud-smooth", "heightfield", "mesh-godobject"}) {
    const auto made = bench.registry.make(name, {});
    if (made) table.rows.push_back({{std::string(name)}, {(*made)->describe().work_bound}});
  }
  return table;
}

}  // namespace

Goal worst_case_goal(const GoalBench& bench, const std::vector<GoalRuns>& shapes,
                     const std::vector<GoalRuns>& sizes) {
  Goal goal{"worst-case", "Strict worst-case runtimes",
            "no frame takes longer than the millisecond that a loop at 1 kHz has, whatever the model."};
  goal.method = {
      "Every frame of every path of the pages on fidelity and on size, timed alone with a clock around it, "
      "in several passes. What hits a frame once is the machine's; what hits it in most passes is the "
      "renderer's. Each renderer states a bound on its work that does not depend on the number of points."};
  std::vector<const GoalRuns*> all;
  for (const GoalRuns& runs : shapes) all.push_back(&runs);
  for (const GoalRuns& runs : sizes) all.push_back(&runs);
  std::vector<Bar> bars;
  for (const char* const judged : kJudged) {
    goal.findings.push_back({fmt::format("{}, longest frame that repeats", judged),
                             largest_over(all, judged, &trace::FrameStatistics::max_us), "µs", kTickUs, true,
                             "a tick at 1 kHz",
                             largest_over(all, kMeshLabel, &trace::FrameStatistics::max_us)});
    goal.findings.push_back({fmt::format("{}, frames over a millisecond", judged), misses(all, judged), "",
                             0.0, true, "none may miss its tick", misses(all, kMeshLabel)});
  }
  for (const std::string& label :
       {std::string("cloud"), std::string("cloud-smooth"), std::string(kMeshLabel)}) {
    if (const auto p999 = largest_over(all, label, &trace::FrameStatistics::p999_us))
      bars.push_back({label + ", 99.9 % under", *p999});
    if (const auto most = largest_over(all, label, &trace::FrameStatistics::max_us))
      bars.push_back({label + ", longest that repeats", *most});
  }
  goal.tables.push_back(goal_frames_table(all));
  goal.tables.push_back(bounds_table(bench));
  goal.figures.push_back(draw(
      bar_chart("goal-worst-case", "The longest frames over all models", "µs", "A tick has 1,000 µs.", bars),
      bench.figures));
  for (const char* const judged : kJudged) describe_longest_reading(all, judged, goal);
  goal.notes.emplace_back(
      "This page measures usual paths. The worst frame in instructions is hunted by `palpate test hunt`.");
  return goal;
}

namespace {

// Allowed growth of the mean frame from ten thousand to a million points. Our own goals, which hold up to ten
// million.
constexpr double kCloudGrowth = 2.0, kSmoothGrowth = 1.5;

std::optional<double> mean_us_of(const GoalRuns& runs, const std::string& label) {
  const metrics::RendererResult* result = ran(runs, label);
  return result != nullptr && result->frame_all ? result->frame_all->mean_us : std::nullopt;
}

std::optional<double> growth_of(const std::vector<GoalRuns>& sizes, const std::string& label) {
  if (sizes.size() < 2) return std::nullopt;
  const auto least = mean_us_of(sizes.front(), label), most = mean_us_of(sizes.back(), label);
  if (!least || !most || !(*least > 0.0)) return std::nullopt;
  return *most / *least;
}

const std::vector<std::string>& size_labels() {
  static const std::vector<std::string> kLabels = {"cloud", "cloud-smooth", kMeshLabel};
  return kLabels;
}

Chart size_chart(const std::vector<GoalRuns>& sizes) {
  Chart chart = growth_chart("goal-insensitive", "points", "One surface, one path; both axes logarithmic.");
  chart.series = lines_of(size_labels());
  for (Series& line : chart.series)
    for (const GoalRuns& runs : sizes)
      if (const std::optional<double> here = mean_us_of(runs, line.label)) {
        line.x.push_back(static_cast<double>(runs.points));
        line.y.push_back(*here);
      }
  return chart;
}

Table size_table(const std::vector<GoalRuns>& sizes) {
  Table table;
  table.title = "Mean of all frames, µs, and what grows besides";
  table.columns = {"renderer"};
  for (const GoalRuns& runs : sizes) table.columns.push_back(format_count(runs.points) + " points");
  for (const std::string& label : size_labels()) {
    std::vector<Cell> means = {{label + ", mean"}}, long_ones = {{label + ", 99.9 % under"}},
                      ready = {{label + ", ready after, ms"}};
    for (const GoalRuns& runs : sizes) {
      const metrics::RendererResult* result = ran(runs, label);
      const bool known = result != nullptr && result->frame_all && result->prepare;
      means.push_back({number_or_dash(mean_us_of(runs, label))});
      long_ones.push_back({number_or_dash(known ? result->frame_all->p999_us : std::nullopt)});
      ready.push_back({number_or_dash(known ? std::optional(result->prepare->total_ms) : std::nullopt)});
    }
    table.rows.insert(table.rows.end(), {means, long_ones, ready});
  }
  return table;
}

}  // namespace

Goal size_goal(const GoalBench& bench, const std::vector<GoalRuns>& sizes) {
  Goal goal{"insensitive", "Runtimes largely insensitive to model complexity",
            "a frame of a model of millions of points takes hardly longer than one of thousands."};
  goal.method = {
      "One surface of 100 x 100 mm and one path, by number of points. Growth is the mean of all frames at "
      "the most points over that at the fewest; it holds the waits for memory of a model that fits no "
      "cache."};
  const std::string from = sizes.empty() ? "0" : format_count(sizes.front().points);
  const std::string to = sizes.empty() ? "0" : format_count(sizes.back().points);
  for (const char* const judged : kJudged)
    goal.findings.push_back(
        {fmt::format("{}, growth of the mean frame from {} to {} points", judged, from, to),
         growth_of(sizes, judged), "times", std::string(judged) == "cloud" ? kCloudGrowth : kSmoothGrowth,
         true, "our own goal", growth_of(sizes, kMeshLabel)});
  goal.tables.push_back(size_table(sizes));
  goal.figures.push_back(draw(size_chart(sizes), bench.figures));
  if (bench.quick) goal.short_of.emplace_back("A quick run has small models: the caches hold them all.");
  goal.notes.emplace_back(
      "Ten million points take minutes and gigabytes: `palpate reproduce --tables growth`.");
  return goal;
}

}  // namespace palpate::experiments
