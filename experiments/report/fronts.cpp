#include "experiments/report/fronts.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "experiments/report/tables.h"

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

struct KindStyle {
  Kind kind;
  const char *label, *beaten, *colour, *pale, *dash;  ///< the dash stands for a shape
};
constexpr KindStyle kKindStyles[] = {
    {Kind::kPoints, "points: best of", "other points", "#0072b2", "#b9d7ea", ""},
    {Kind::kMesh, "meshes: best of", "other meshes", "#d55e00", "#f3cfb5", "(10,5)"},
    {Kind::kField, "distance grids: best of", "other distance grids", "#009e73", "#b5e2d4", "(3,4)"},
    {Kind::kHeights, "height fields: best of", "other height fields", "#555555", "#cccccc", "(1,1)"},
};

/// Settings that nothing of their kind beats in both numbers, the most accurate first.
std::vector<FrontPoint> front_of(std::vector<FrontPoint> points) {
  for (FrontPoint& point : points)
    point.on_front = std::none_of(points.begin(), points.end(), [&](const FrontPoint& other) {
      return other.error <= point.error && other.cost <= point.cost &&
             (other.error < point.error || other.cost < point.cost);
    });
  return numbered(std::move(points));
}

Series marks_of(const std::vector<FrontPoint>& points, const std::string& label, const char* colour,
                const char* dash, bool with_bars) {
  Series series{label, colour, {}, {}, dash};
  for (const FrontPoint& point : points) {
    const double x = drawn_error(point.error);
    series.x.push_back(x);
    series.y.push_back(point.cost);
    series.bars.push_back(with_bars
                              ? Series::Bars{drawn_error(point.error_low), drawn_error(point.error_high),
                                             point.cost_low, point.cost_high}
                              : Series::Bars{x, x, point.cost, point.cost});
  }
  return series;
}

/// Shares of a picture across and upwards: of points, and of the names beside them.
struct PictureBox {
  double left, right, low, high;
  [[nodiscard]] bool meets(const PictureBox& other) const {
    return left < other.right && other.left < right && low < other.high && other.low < high;
  }
};

/// Where points stand in a picture with logarithmic axes.
class Picture {
 public:
  explicit Picture(const std::vector<FrontPoint>& points) {
    for (const FrontPoint& point : points) {
      all_.left = std::min(all_.left, std::log(drawn_error(point.error)));
      all_.right = std::max(all_.right, std::log(drawn_error(point.error)));
      all_.low = std::min(all_.low, std::log(point.cost));
      all_.high = std::max(all_.high, std::log(point.cost));
    }
    constexpr double kDot = 0.006;
    for (const FrontPoint& point : points) {
      const auto [x, y] = at(point);
      taken_.push_back({x - kDot, x + kDot, y - kDot, y + kDot});
    }
  }
  /// Room for a name of so many letters beside a point that covers neither point nor name: a place of
  /// gnuplot's, and the room is taken; empty where there is none.
  std::string take_room(const FrontPoint& point, std::size_t letters) {
    constexpr double kLetter = 0.0075, kLine = 0.045, kOff = 0.008, kUp = 0.012;  // of a wide figure
    const auto [x, y] = at(point);
    const double wide = kLetter * static_cast<double>(letters);
    for (const bool right : {true, false})
      for (const bool above : {true, false}) {
        const double left = right ? x + kOff : x - kOff - wide, low = above ? y + kUp : y - kUp - kLine;
        const PictureBox box{left, left + wide, low, low + kLine};
        if (std::any_of(taken_.begin(), taken_.end(),
                        [&](const PictureBox& other) { return box.meets(other); }))
          continue;
        taken_.push_back(box);
        return fmt::format("{} offset {},{}", right ? "left" : "right", right ? 0.6 : -0.6,
                           above ? 0.6 : -0.6);
      }
    return {};
  }

 private:
  [[nodiscard]] std::pair<double, double> at(const FrontPoint& point) const {
    constexpr double kLeastExtent = 1e-9;  // of a single point
    return {(std::log(drawn_error(point.error)) - all_.left) / std::max(all_.right - all_.left, kLeastExtent),
            (std::log(point.cost) - all_.low) / std::max(all_.high - all_.low, kLeastExtent)};
  }
  PictureBox all_{HUGE_VAL, -HUGE_VAL, HUGE_VAL, -HUGE_VAL};
  std::vector<PictureBox> taken_;
};

/// Each renderer's name once, beside its most accurate point that has room for it: on a front, else at all.
std::string names_beside(const std::vector<std::vector<FrontPoint>>& fronts,
                         const std::vector<KindPoint>& all) {
  std::vector<FrontPoint> others, in_order;
  for (const KindPoint& one : all) {
    others.push_back(one.point);
    others.back().on_front = true;  // for their order alone
  }
  others = numbered(std::move(others));
  Picture picture(others);
  for (const std::vector<FrontPoint>& front : fronts)
    in_order.insert(in_order.end(), front.begin(), front.end());
  const std::size_t best = in_order.size();
  in_order.insert(in_order.end(), others.begin(), others.end());
  std::string commands;
  std::set<std::string> named;
  for (std::size_t i = 0; i < in_order.size(); ++i) {
    const FrontPoint& point = in_order[i];
    if (named.contains(point.group)) continue;
    const std::string room = picture.take_room(point, point.group.size());
    if (room.empty()) continue;
    named.insert(point.group);
    commands +=
        fmt::format("set label '{}' at {:.7g},{:.7g} {} font ',12' textcolor rgb '{}' front\n", point.group,
                    drawn_error(point.error), point.cost, room, i < best ? "#222222" : "#777777");
  }
  return commands;
}

Chart cost_chart(const std::string& name, const std::string& title, const std::string& cost) {
  Chart chart;
  chart.name = name;
  chart.title = title;
  chart.x_label = "error of force, 95th percentile, % of the true force";
  chart.y_label = cost;
  chart.log_x = chart.log_y = true;
  chart.style = Chart::Style::kMarks;
  chart.height = kFrontHeight;
  chart.wide = true;
  chart.nothing = "No setting was measured.";
  return chart;
}

}  // namespace

Chart kinds_chart(const std::string& name, const std::string& title, const std::string& cost,
                  const std::vector<KindPoint>& points) {
  Chart chart = cost_chart(name, title, cost);
  chart.caption =
      "Left is more accurate, down is cheaper; bars are 95 % intervals. Each line joins the settings of one "
      "kind that no other of its kind beats; the pale ones are beaten.";
  std::vector<std::vector<FrontPoint>> fronts;
  std::vector<Series> above;
  for (const KindStyle& drawn : kKindStyles) {
    std::vector<FrontPoint> of_kind;
    for (const KindPoint& one : points)
      if (one.kind == drawn.kind) of_kind.push_back(one.point);
    if (of_kind.empty()) continue;
    const std::vector<FrontPoint> front = front_of(of_kind);
    std::erase_if(of_kind, [&](const FrontPoint& point) {
      return std::any_of(front.begin(), front.end(),
                         [&](const FrontPoint& best) { return best.setting == point.setting; });
    });
    const std::size_t count = front.size() + of_kind.size();
    if (!of_kind.empty())
      chart.series.push_back(marks_of(of_kind, drawn.beaten, drawn.pale, drawn.dash, false));
    Series line = line_of(front);
    line.colour = drawn.colour;
    above.push_back(std::move(line));
    above.push_back(
        marks_of(front, fmt::format("{} {}", drawn.label, count), drawn.colour, drawn.dash, true));
    fronts.push_back(front);
  }
  chart.series.insert(chart.series.end(), above.begin(), above.end());
  chart.extra =
      "set bars 0\nset autoscale xfix\nset autoscale yfix\n"
      "set offsets graph 0.03, graph 0.12, graph 0.08, graph 0.05\n" +
      names_beside(fronts, points);
  return chart;
}

Chart trade_chart(const std::string& name, const metrics::ResultDocument& document) {
  using R = metrics::RendererResult;
  const auto error_of = [](const R& r) { return settled_score(r, &metrics::Accuracy::force_rms_percent); };
  const auto is_number = [](const std::optional<double>& v) { return v && std::isfinite(*v); };
  const bool errors = std::any_of(document.renderers.begin(), document.renderers.end(),
                                  [&](const R& r) { return competes(r) && is_number(error_of(r)); });
  std::vector<KindPoint> points;
  bool exact = false;
  for (const R& r : document.renderers) {
    const std::optional<double> across = errors ? error_of(r) : prepare_ms(r);
    const auto& frames = r.frame_all ? r.frame_all : r.frame;
    if (!competes(r) || !is_number(across) || !frames || !is_number(frames->mean_us) ||
        !(*frames->mean_us > 0))
      continue;
    const Interval cost = frames->mean_interval_us.value_or(Interval{*frames->mean_us, *frames->mean_us});
    const Interval error =
        (errors ? r.accuracy->force_rms_percent_interval : std::nullopt).value_or(Interval{*across, *across});
    const Kind kind = r.works_on == render::Geometry::kMesh      ? Kind::kMesh
                      : r.works_on == render::Geometry::kHeights ? Kind::kHeights
                                                                 : Kind::kPoints;
    exact = exact || *across < kLeastErrorPercent;
    points.push_back(
        {kind,
         {r.label, r.label, *frames->mean_us, cost.low, cost.high, *across, error.low, error.high, false}});
  }
  Chart chart = kinds_chart(name, errors ? "Time against error" : "Time against preparation",
                            "mean of all frames, µs", points);
  chart.x_label = errors ? "force error, RMS, % of the true force" : "preparation, ms";
  chart.caption = fmt::format(
      "Left is {}, down is faster; bars are 95 % intervals. A line joins the renderers of one kind that no "
      "other of its kind beats in both; the pale ones are beaten.{}",
      errors ? "more accurate" : "sooner ready",
      exact ? fmt::format(" What is exact, or below {:g} %, stands at the left edge.", kLeastErrorPercent)
            : "");
  chart.nothing = "No frame was timed.";
  return chart;
}

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
  Chart chart = cost_chart(name, title, cost);
  chart.caption =
      "Left is more accurate, down is cheaper; thin bars are 95 % intervals. Numbers are those of the table: "
      "nothing measured is both more accurate and cheaper than these.";
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
  const std::vector<LineStyle> styles = line_styles_of(labels);
  std::size_t at = 0;
  for (auto& [label, series] : groups) {
    series.colour = styles[at].colour;
    series.dash = styles[at++].dash;
    chart.series.push_back(std::move(series));
  }
  return chart;
}

}  // namespace palpate::experiments
