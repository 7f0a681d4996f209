#include "experiments/report/fronts.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

namespace palpate::experiments {
namespace {

constexpr int kFrontHeight = 460;
constexpr const char* kFrontColour = "#555555";

double drawn_error(double percent) {
  return std::max(percent, kLeastErrorPercent);
}

Series line_of(const std::vector<FrontPoint>& front) {
  Series line{"front", kFrontColour, {}, {}, {}};
  for (const FrontPoint& point : front) {
    // By value alone: what is on the front within its interval may lie above the line.
    if (!line.y.empty() && point.cost >= line.y.back()) continue;
    line.x.push_back(drawn_error(point.error));
    line.y.push_back(point.cost);
  }
  return line;
}

/// The numbers, each beside its point.
std::string numbers_beside(const std::vector<FrontPoint>& front) {
  std::string commands;
  for (std::size_t i = 0; i < front.size(); ++i)
    commands += fmt::format(
        "set label {0} '{0}' at {1:.7g},{2:.7g} offset 0.5,0.4 font ',11' textcolor rgb '#222222' front\n",
        i + 1, drawn_error(front[i].error), front[i].cost);
  return commands;
}

}  // namespace

std::vector<FrontPoint> numbered(std::vector<FrontPoint> points) {
  std::erase_if(points, [](const FrontPoint& point) { return !point.on_front; });
  std::sort(points.begin(), points.end(), [](const FrontPoint& a, const FrontPoint& b) {
    if (a.error != b.error) return a.error < b.error;
    return a.cost != b.cost ? a.cost < b.cost : a.setting < b.setting;
  });
  return points;
}

Chart front_chart(const std::string& name, const std::string& title, const std::string& cost,
                  std::vector<FrontPoint> points) {
  Chart chart;
  chart.name = name;
  chart.title = title;
  chart.caption =
      "Left is more accurate, down is cheaper; thin bars are 95 % intervals. Numbers are those of the table: "
      "nothing measured is both more accurate and cheaper than these.";
  chart.x_label = "error of force, 95th percentile, % of the true force";
  chart.y_label = cost;
  chart.log_x = chart.log_y = true;
  chart.style = Chart::Style::kMarks;
  chart.height = kFrontHeight;
  chart.wide = true;
  chart.nothing = "No setting was measured.";
  const std::vector<FrontPoint> front = numbered(points);
  chart.extra =
      "set bars 0\nset offsets graph 0.03, graph 0.05, graph 0.05, graph 0.05\n" + numbers_beside(front);
  if (std::any_of(points.begin(), points.end(),
                  [](const FrontPoint& point) { return point.error < kLeastErrorPercent; }))
    chart.caption += fmt::format(" Errors below {:g} % stand at the left edge.", kLeastErrorPercent);
  chart.series.push_back(line_of(front));
  std::map<std::string, Series> groups;
  for (const FrontPoint& point : points) {
    Series& series = groups.try_emplace(point.group, Series{point.group, {}, {}, {}, {}}).first->second;
    series.x.push_back(drawn_error(point.error));
    series.y.push_back(point.cost);
    series.bars.push_back(
        {drawn_error(point.error_low), drawn_error(point.error_high), point.cost_low, point.cost_high});
  }
  std::vector<std::string> labels;
  for (const auto& [label, series] : groups) labels.push_back(label);
  const std::vector<Look> looks = looks_of(labels);
  std::size_t at = 0;
  for (auto& [label, series] : groups) {
    series.colour = looks[at].colour;
    series.dash = looks[at++].dash;
    chart.series.push_back(std::move(series));
  }
  return chart;
}

}  // namespace palpate::experiments
