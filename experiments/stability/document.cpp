#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>

#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "experiments/stability/stability.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {

PALPATE_JSON_MEMBERS(StabilityDocument, scene, path, truth, device, hand, stiffness_n_per_mm, truth_stable,
                     warnings, notes, points, tasks, scores)

namespace {

std::string shown_number(const std::optional<double>& number) {
  return number ? format_number(*number) : kMissingNumber;
}

std::string turned_text(const StabilityPoint& point) {
  if (point.varied == "rate") return fmt::format("{:g} Hz", point.rate_hz);
  if (point.varied == "delay") return fmt::format("{:g} ms of delay", point.delay_ms);
  if (point.varied == "damping") return fmt::format("{:g} N·s/mm in the wall", point.damping_n_s_per_mm);
  return point.control == "none" ? "no control" : point.control;
}

/// Rows: varied quantity per hand; columns: renderers.
Table limits_table(const StabilityDocument& document) {
  Table table;
  table.title = "Largest stable stiffness, N/mm";
  table.columns = {"hand, what is turned"};
  std::vector<std::string> renderers;
  for (const StabilityPoint& point : document.points)
    if (std::find(renderers.begin(), renderers.end(), point.renderer) == renderers.end())
      renderers.push_back(point.renderer);
  table.columns.insert(table.columns.end(), renderers.begin(), renderers.end());
  table.columns.insert(table.columns.end(), {"plane, linear", "any hand"});
  std::vector<std::pair<std::string, std::vector<Cell>>> rows;
  for (const StabilityPoint& point : document.points) {
    if (point.varied == "cross") continue;  // has its own tables
    const std::string name = point.hand + ", " + turned_text(point);
    auto row = std::find_if(rows.begin(), rows.end(), [&](const auto& r) { return r.first == name; });
    if (row == rows.end()) {
      std::vector<Cell> cells(table.columns.size(), Cell{kMissingNumber});
      cells.front() = Cell{name};
      cells[cells.size() - 2] = Cell{shown_number(point.theory_n_per_mm)};
      cells.back() = Cell{shown_number(point.passive_n_per_mm)};
      row = rows.insert(rows.end(), {name, std::move(cells)});
    }
    const auto at = static_cast<std::size_t>(std::find(renderers.begin(), renderers.end(), point.renderer) -
                                             renderers.begin());
    row->second[at + 1] = Cell{limit_text(point)};
  }
  for (auto& [name, cells] : rows) table.rows.push_back(std::move(cells));
  table.notes.emplace_back("Truth: the true surface in the renderer's place.");
  table.notes.emplace_back(
      "Plane, linear: where the loop of a plane without friction and encoder loses its stability, exactly. "
      "Any hand: the bound below which no hand can make it swing.");
  return table;
}

Table cycles_table(const StabilityDocument& document) {
  Table table;
  table.title = "Just above the limit, at 1 kHz";
  table.columns = {"renderer, hand, control", "swing, mm", "at, Hz", "energy given, mJ", "held"};
  for (const StabilityPoint& point : document.points)
    if (point.varied == "control" && !point.unlimited)
      table.rows.push_back({{fmt::format("{}, {}, {}", point.renderer, point.hand, turned_text(point))},
                            {format_number(point.limit_cycle_mm)},
                            {format_number(point.limit_cycle_hz)},
                            {format_number(point.generated_mj)},
                            {point.lost ? "no" : "yes"}});
  return table;
}

Table tasks_table(const StabilityDocument& document) {
  Table table;
  table.title = "The hand's way, against the way with the truth in the loop";
  table.columns = {"renderer",        "task",       "off, RMS mm", "off, most mm", "energy given, mJ",
                   "largest step, N", "its excess", "the truth's", "stable"};
  for (const TaskResult& task : document.tasks)
    table.rows.push_back({{task.renderer},
                          {task.task},
                          {format_number(task.contour_rms_mm)},
                          {format_number(task.contour_max_mm)},
                          {format_number(task.generated_mj)},
                          {format_number(task.largest_step_n)},
                          {format_number(task.largest_excess_n)},
                          {format_number(task.truth_largest_excess_n)},
                          {task.stable ? "yes" : "no"}});
  table.notes.push_back(fmt::format("At the scene's {:g} N/mm, 1 kHz, the hand '{}' on '{}'.",
                                    document.stiffness_n_per_mm, document.hand, document.device));
  return table;
}

Table scores_table(const StabilityDocument& document) {
  Table table;
  table.title = "Scores along the path: replayed, and under the hand";
  table.columns = {"renderer",        "loop",
                   "force error, %",  "direction p99, °",
                   "as the truth, %", "ripple, times noticed",
                   "after the motors"};
  for (const LoopScores& scores : document.scores)
    for (const auto& [loop, side] : {std::pair{"open", &scores.open}, {"closed", &scores.closed}})
      table.rows.push_back({{scores.renderer},
                            {loop},
                            {shown_number(side->force_rms_percent)},
                            {shown_number(side->direction_p99_deg)},
                            {shown_number(side->indistinguishable_percent)},
                            {shown_number(side->ripple_ratio)},
                            {shown_number(side->ripple_shown_ratio)}});
  table.notes.emplace_back(
      "The truth is the closest point of the true surface, in both. Closed: along the way that the hand "
      "took, as the encoders saw it.");
  return table;
}

double abscissa(const StabilityPoint& point, const std::string& varied) {
  return varied == "rate" ? point.rate_hz : varied == "delay" ? point.delay_ms : point.damping_n_s_per_mm;
}

/// One hand, one axis: a line per renderer, and theory.
Chart limit_chart(const StabilityDocument& document, const std::string& varied, const std::string& hand) {
  Chart chart;
  chart.name = fmt::format("limit-{}-{}", varied, hand);
  chart.title =
      fmt::format("Largest stable stiffness, {}", hand == "released" ? "released" : "held by the " + hand);
  chart.x_label = varied == "rate"    ? "rate of the servo, Hz"
                  : varied == "delay" ? "delay, ms"
                                      : "damping of the wall, N·s/mm (Z-width)";
  chart.y_label = "N/mm";
  chart.log_x = varied == "rate";
  chart.log_y = true;
  chart.style = Chart::Style::kMarkedLines;
  chart.caption =
      "Grey: the linear loop of a plane, exactly. Below a line the renderer rests under the hand; a line "
      "ends where nothing was stable.";
  std::vector<std::string> labels;
  std::map<std::string, Series> lines;
  Series theory{"plane, linear", "#999999", {}, {}, {}, true};
  for (const StabilityPoint& point : document.points) {
    if (point.varied != varied || point.hand != hand) continue;
    if (lines.empty()) labels.clear();
    Series& line = lines.try_emplace(point.renderer, Series{point.renderer, {}, {}, {}, {}}).first->second;
    if (point.renderer == document.points.front().renderer && point.theory_n_per_mm &&
        *point.theory_n_per_mm > 0.0) {
      theory.x.push_back(abscissa(point, varied));
      theory.y.push_back(*point.theory_n_per_mm);
    }
    if (!(point.largest_stable_n_per_mm > 0.0)) continue;
    line.x.push_back(abscissa(point, varied));
    line.y.push_back(point.largest_stable_n_per_mm);
  }
  if (!theory.x.empty()) chart.series.push_back(std::move(theory));
  for (const auto& [label, line] : lines) labels.push_back(label);
  const std::vector<LineStyle> styles = line_styles_of(labels);
  std::size_t at = 0;
  for (auto& [label, line] : lines) {
    line.colour = styles[at].colour;
    line.dash = styles[at++].dash;
    chart.series.push_back(std::move(line));
  }
  return chart;
}

}  // namespace

std::string to_json(const StabilityDocument& document) {
  DocumentJson json = begin_json(kStabilitySchema, document.head);
  to_json(json, document);
  return document_text(json);
}

std::vector<Table> stability_tables(const StabilityDocument& document) {
  std::vector<Table> tables = {limits_table(document), tasks_table(document), scores_table(document)};
  for (Table& table : cross_tables(document)) tables.push_back(std::move(table));
  if (Table cycles = cycles_table(document); !cycles.rows.empty()) tables.push_back(std::move(cycles));
  return tables;
}

Page stability_page(const StabilityDocument& document, const OutputFolder& folder) {
  Page page = begin_page("Renderers in the loop with a hand", document.head);
  add_known(page, {{}, document.warnings, document.notes});
  Section section;
  section.id = "stability";
  section.title = fmt::format("{} on the simulated {}", document.scene, document.device);
  section.paragraphs.emplace_back(
      "A simulated hand holds a simulated device and steers towards a goal; the renderer's force moves both. "
      "No device and no person was measured.");
  std::vector<std::string> hands;
  for (const StabilityPoint& point : document.points)
    if (std::find(hands.begin(), hands.end(), point.hand) == hands.end()) hands.push_back(point.hand);
  const Result<OutputFolder> figures = folder.inside("figures");
  for (const char* const varied : {"damping", "rate", "delay"})
    for (const std::string& hand : hands) {
      const Chart chart = limit_chart(document, varied, hand);
      if (!figures || !has_points(chart)) continue;
      section.figures.push_back(draw(chart, *figures));
    }
  for (const Chart& chart : cross_charts(document))
    if (figures && has_points(chart)) section.figures.push_back(draw(chart, *figures));
  section.tables = stability_tables(document);
  section.facts.push_back({"path of the goal", {document.path}});
  section.facts.push_back({"ground truth", {document.truth}});
  page.sections.push_back(std::move(section));
  return page;
}

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
