#include "experiments/stability/stability.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr const char* kCrossed = "cross";

struct ControlStyle {
  const char *name, *words, *colour;  // colours of Okabe and Ito
};
constexpr std::array<ControlStyle, 3> kControlStyles = {{{"none", "no control", "#0072b2"},
                                                         {"coupling", "passive coupling", "#009e73"},
                                                         {"passivity", "passivity controller", "#d55e00"}}};
constexpr std::array<const char*, 5> kDelayDashes = {"", "(10,5)", "(3,4)", "(12,4,3,4)", "(6,3,2,3,2,3)"};

const ControlStyle& style_of(const std::string& control) {
  const auto at = std::find_if(kControlStyles.begin(), kControlStyles.end(),
                               [&](const ControlStyle& drawn) { return control == drawn.name; });
  return at == kControlStyles.end() ? kControlStyles.front() : *at;
}

/// Distinct values in order of appearance.
template <class Value, class Of>
std::vector<Value> crossed_values(const StabilityDocument& document, const Of& of) {
  std::vector<Value> values;
  for (const StabilityPoint& point : document.points)
    if (point.varied == kCrossed && std::find(values.begin(), values.end(), of(point)) == values.end())
      values.push_back(of(point));
  return values;
}

/// One renderer's cross points for a hand, control and delay, by rate.
std::vector<const StabilityPoint*> along_rates(const StabilityDocument& document, const std::string& renderer,
                                               const std::string& hand, const std::string& control,
                                               double delay_ms) {
  std::vector<const StabilityPoint*> points;
  for (const StabilityPoint& point : document.points)
    if (point.varied == kCrossed && point.renderer == renderer && point.hand == hand &&
        point.control == control && point.delay_ms == delay_ms)
      points.push_back(&point);
  return points;
}

struct CrossedAxes {
  std::vector<std::string> renderers, hands, controls;
  std::vector<double> delays, rates;
  explicit CrossedAxes(const StabilityDocument& document)
      : renderers(crossed_values<std::string>(document, [](const StabilityPoint& p) { return p.renderer; })),
        hands(crossed_values<std::string>(document, [](const StabilityPoint& p) { return p.hand; })),
        controls(crossed_values<std::string>(document, [](const StabilityPoint& p) { return p.control; })),
        delays(crossed_values<double>(document, [](const StabilityPoint& p) { return p.delay_ms; })),
        rates(crossed_values<double>(document, [](const StabilityPoint& p) { return p.rate_hz; })) {}
};

Table cross_table(const StabilityDocument& document, const CrossedAxes& axes, const std::string& renderer) {
  Table table;
  table.title = fmt::format("Largest stable stiffness over rate and delay, N/mm: {}", renderer);
  table.columns = {"hand, control, delay"};
  for (const double rate : axes.rates) table.columns.push_back(fmt::format("{:g} Hz", rate));
  for (const std::string& hand : axes.hands)
    for (const std::string& control : axes.controls)
      for (const double delay : axes.delays) {
        std::vector<Cell> row = {{fmt::format("{}, {}, {:g} ms", hand, style_of(control).words, delay)}};
        for (const StabilityPoint* const point : along_rates(document, renderer, hand, control, delay))
          row.push_back({limit_text(*point)});
        table.rows.push_back(std::move(row));
      }
  if (renderer != axes.renderers.front()) return table;
  for (const std::string& hand : axes.hands)
    for (const double delay : axes.delays) {
      std::vector<Cell> row = {{fmt::format("{}, plane, linear, {:g} ms", hand, delay)}};
      for (const StabilityPoint* const point : along_rates(document, renderer, hand, "none", delay))
        row.push_back({point->theory_n_per_mm ? format_number(*point->theory_n_per_mm) : kMissingNumber});
      table.rows.push_back(std::move(row));
    }
  table.notes.emplace_back("Plane, linear: the loop of a plane without friction and encoder, exactly.");
  return table;
}

Chart cross_chart(const StabilityDocument& document, const CrossedAxes& axes, const std::string& renderer,
                  const std::string& hand) {
  Chart chart;
  chart.name = fmt::format("limit-cross-{}-{}", renderer, hand);
  chart.title = fmt::format("Largest stable stiffness over rate and delay: {}, {}", renderer,
                            hand == "released" ? "released" : "held by the " + hand);
  chart.x_label = "rate of the servo, Hz";
  chart.y_label = "N/mm";
  chart.log_x = chart.log_y = true;
  chart.wide = true;
  chart.style = Chart::Style::kMarkedLines;
  chart.caption =
      "Colour: control. Dashes: delay. A line ends where nothing was stable; at the top even the stiffest "
      "wall that was tried is stable.";
  for (const std::string& control : axes.controls)
    for (std::size_t d = 0; d < axes.delays.size(); ++d) {
      const ControlStyle& drawn = style_of(control);
      Series line{fmt::format("{}, {:g} ms", drawn.words, axes.delays[d]),
                  drawn.colour,
                  {},
                  {},
                  kDelayDashes[d % kDelayDashes.size()]};
      for (const StabilityPoint* const point :
           along_rates(document, renderer, hand, control, axes.delays[d])) {
        if (!(point->largest_stable_n_per_mm > 0.0)) continue;
        line.x.push_back(point->rate_hz);
        line.y.push_back(point->largest_stable_n_per_mm);
      }
      if (!line.x.empty()) chart.series.push_back(std::move(line));
    }
  return chart;
}

}  // namespace

std::string limit_text(const StabilityPoint& point) {
  if (point.unlimited) return "over " + format_number(point.largest_stable_n_per_mm);
  return point.largest_stable_n_per_mm > 0.0 ? format_number(point.largest_stable_n_per_mm) : "none";
}

std::vector<Table> cross_tables(const StabilityDocument& document) {
  const CrossedAxes axes(document);
  std::vector<Table> tables;
  for (const std::string& renderer : axes.renderers) tables.push_back(cross_table(document, axes, renderer));
  return tables;
}

std::vector<Chart> cross_charts(const StabilityDocument& document) {
  const CrossedAxes axes(document);
  std::vector<Chart> charts;
  for (const std::string& renderer : axes.renderers)
    for (const std::string& hand : axes.hands) charts.push_back(cross_chart(document, axes, renderer, hand));
  return charts;
}

}  // namespace palpate::experiments
