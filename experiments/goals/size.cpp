#include <fmt/format.h>

#include "experiments/goals/measures.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
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
