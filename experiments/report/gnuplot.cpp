// Charts through gnuplot.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <span>

#include "experiments/report/figures.h"
#include "experiments/report/tables.h"
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/process.h"

namespace palpate::experiments {
namespace {

const std::string kNotDrawn = "This figure could not be drawn: ";
constexpr double kGnuplotLimitS = 60.0;
constexpr int kHeight = 360, kWidth = 560,
              kWideWidth = 1120;  // shown at nearly these sizes: letters stay legible

std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text)
    out += c == '\'' ? std::string("''") : c == '\n' ? std::string(" ") : std::string(1, c);
  return out + "'";
}

std::string data_text(const Chart& chart) {
  std::string text;
  for (const Series& s : chart.series) {
    text += "# " + s.label + "\n";
    for (std::size_t i = 0; i < s.x.size(); ++i)
      // No blank lines within a series: two of them begin the next one.
      text += !std::isfinite(s.y[i])
                  ? "NaN NaN\n"
                  : fmt::format("{:.7g} {:.7g}{}\n", s.x[i], s.y[i],
                                i < s.bars.size()
                                    ? fmt::format(" {:.7g} {:.7g} {:.7g} {:.7g}", s.bars[i].x_low,
                                                  s.bars[i].x_high, s.bars[i].y_low, s.bars[i].y_high)
                                    : "");
    if (s.x.empty()) text += "NaN NaN\n";
    text += "\n\n";
  }
  return text;
}

/// By Chart::Style; of kMarks the line among them.
const char* style_name(Chart::Style style) {
  static constexpr const char* kNames[] = {
      "lines lw 1.4",  "steps lw 1.2", "linespoints pt 7 ps 0.6 lw 1.6", "boxxyerror fs solid 0.9 noborder",
      "fsteps lw 1.2", "lines lw 1.6"};
  return kNames[static_cast<std::size_t>(style)];
}

/// Dashes of lines, each with gnuplot's number of the mark that stands for it where there are no lines.
constexpr std::pair<const char*, int> kDashes[] = {
    {"", 7}, {"(10,5)", 9}, {"(3,4)", 5}, {"(12,4,3,4)", 13}, {"(6,3,2,3,2,3)", 11}};

/// Marks of one colour are told apart by their shapes, as lines are by their dashes.
std::string mark_of(const Series& series) {
  int shape = 15;  // of any other dash
  for (const auto& [dash, mark] : kDashes)
    if (series.dash == dash) shape = mark;
  return fmt::format("xyerrorbars pt {} ps 0.6 lw 0.7", shape);
}

/// Lines on top of each other are told apart by their dashes, in print as well.
std::string dashes(const Chart& chart, const Series& series) {
  const bool drawn = chart.style == Chart::Style::kLines || chart.style == Chart::Style::kMarkedLines ||
                     chart.style == Chart::Style::kSteps;
  return drawn && !series.dash.empty() ? " dt " + series.dash : "";
}

/// Rows of the legend above the plot: gnuplot takes their room from the plot.
int legend_rows(const Chart& chart) {
  constexpr int kLetter = 8, kSample = 60, kMargins = 90;  // of the font, the line before it, the axes
  if (chart.style == Chart::Style::kBars || chart.style == Chart::Style::kPanels) return 1;
  int longest = 0;
  for (const Series& series : chart.series)
    longest = std::max(longest, static_cast<int>(text_width(series.label)));
  const int in_row =
      std::max(1, ((chart.wide ? kWideWidth : kWidth) - kMargins) / (kLetter * longest + kSample));
  return (static_cast<int>(chart.series.size()) + in_row - 1) / in_row;
}

std::string columns_of(const Chart& chart) {
  constexpr double kHalfBar = 0.32;
  if (chart.style != Chart::Style::kBars) return "1:2";
  return fmt::format("1:2:({0:.7g}):1:($2-{1}):($2+{1})", chart.bars_from, kHalfBar);
}

constexpr std::size_t kPanelColumns = 4;
constexpr int kPanelHeight = 180;
constexpr double kSpareRoom = 0.6, kFlatRoom = 0.2, kPanelTics = 4.0;

/// Every series behind the first one that has anything to show.
std::size_t panels_of(const Chart& chart) {
  const auto shown = std::count_if(chart.series.begin() + 1, chart.series.end(),
                                   [](const Series& series) { return !series.x.empty(); });
  return std::max<std::size_t>(1, static_cast<std::size_t>(shown));
}

struct Range {
  double low = 0.0, high = 0.0;
};

/// The truth and as much again: what leaves that has left it, and runs along the edge.
Range range_about(const Series& truth) {
  Range truly;
  for (const double y : truth.y) {
    truly.low = std::min(truly.low, y);
    truly.high = std::max(truly.high, y);
  }
  const double room = truly.high > truly.low ? truly.high - truly.low : kFlatRoom;
  return {truly.low - kSpareRoom * room, truly.high + kSpareRoom * room};
}

bool leaves(const Chart& chart) {
  if (chart.style != Chart::Style::kPanels || chart.log_y) return false;
  const Range range = range_about(chart.series.front());
  return std::any_of(chart.series.begin(), chart.series.end(), [&](const Series& series) {
    return std::any_of(series.y.begin(), series.y.end(),
                       [&](double y) { return y < range.low || y > range.high; });
  });
}

/// Points beyond the range come back to its edge.
std::string column_within(const Range& range) {
  return fmt::format("($2 > {0:.6g} ? {0:.6g} : $2 < {1:.6g} ? {1:.6g} : $2)", range.high, range.low);
}

/// A step of tics that gives about kPanelTics over an extent: 1, 2 or 5 times a power of ten.
double tic_step(double extent) {
  constexpr double kTen = 10.0, kFive = 5.0;
  if (!(extent > 0.0)) return 1.0;
  const double raw = extent / kPanelTics, power = std::pow(kTen, std::floor(std::log10(raw)));
  return raw / power < 2.0 ? 2.0 * power : raw / power < kFive ? kFive * power : kTen * power;
}

std::string linear_range(const Range& range) {
  return fmt::format("set yrange [{:.6g}:{:.6g}]\nset ytics {:.6g}\n", range.low, range.high,
                     tic_step(range.high - range.low));
}

/// The positive values of an axis; empty (low above high) if there are none.
Range positive_range(const Chart& chart, char axis) {
  Range range{std::numeric_limits<double>::max(), 0.0};
  for (const Series& series : chart.series)
    for (const double v : axis == 'x' ? series.x : series.y) {
      if (!std::isfinite(v) || !(v > 0.0)) continue;
      range.low = std::min(range.low, v);
      range.high = std::max(range.high, v);
    }
  return range;
}

/// All that there is, in whole powers of ten.
std::string logarithmic_range(const Chart& chart) {
  const Range range = positive_range(chart, 'y');
  if (range.low > range.high) return "";
  const int low = static_cast<int>(std::floor(std::log10(range.low)));
  const int high = static_cast<int>(std::ceil(std::log10(range.high)));
  constexpr int kMostTics = 4;
  const int step = std::max(1, (high - low + kMostTics - 1) / kMostTics);
  return fmt::format("set yrange [1e{}:1e{}]\nset ytics 1e{}\nset format y '10^{{%T}}'\nunset mytics\n", low,
                     std::max(high, low + 1), step);
}

/// Labels of a logarithmic axis with at most two powers of ten on it: gnuplot would label those alone.
std::string log_tics(const Chart& chart, char axis) {
  constexpr double kWide = 20.0;  // ten leaves one or two powers, and intervals reach beyond the values
  const Range range = positive_range(chart, axis);
  if (range.low > range.high || range.high > kWide * range.low) return "";
  std::string tics;
  const int last = static_cast<int>(std::ceil(std::log10(range.high)));
  for (int power = static_cast<int>(std::floor(std::log10(range.low))); power <= last; ++power)
    for (const double digit : {1.0, 1.5, 2.0, 3.0, 5.0, 7.0})
      tics += fmt::format("{}{}e{}", tics.empty() ? "" : ", ", digit, power);
  return fmt::format("set {}tics ({})\n", axis, tics);
}

/// All on the same axes, so that they can be compared; only the outer ones have labels.
std::string panels_text(const Chart& chart) {
  const std::size_t rows = (panels_of(chart) + kPanelColumns - 1) / kPanelColumns;
  const Range range = range_about(chart.series.front());
  const std::vector<double>& x = chart.series.front().x;
  const double tics = x.empty() ? 1.0 : tic_step(x.back() - x.front());
  std::string s = fmt::format(
      "unset key\nset xlabel ''\nset ylabel ''\n{}set xtics {:.6g}\n"
      "set multiplot layout {},{} margins char 7, char 2, char 2.5, char 2 spacing char 5.5, char 4.5\n",
      chart.log_y ? logarithmic_range(chart) : linear_range(range), tics, rows, kPanelColumns);
  for (std::size_t i = 1; i < chart.series.size(); ++i) {
    if (chart.series[i].x.empty()) continue;
    s += fmt::format(
        "set title {0} noenhanced offset 0,-0.6 font ',13'\n"
        "plot '{1}.dat' index 0 using 1:2 with lines lw 5 lc rgb '{2}', '{1}.dat' index {3} using 1:{6} with "
        "{4} lc rgb '{5}'\n",
        quoted(chart.series[i].label), chart.name, chart.series.front().colour, i, style_name(chart.style),
        chart.series[i].colour, chart.log_y ? "2" : column_within(range));
  }
  return s + "unset multiplot\n";
}

int height_of(const Chart& chart) {
  constexpr int kLegendRow = 20;
  if (chart.style != Chart::Style::kPanels)
    return (chart.height > 0 ? chart.height : kHeight) + (legend_rows(chart) - 1) * kLegendRow;
  return kPanelHeight * static_cast<int>((panels_of(chart) + kPanelColumns - 1) / kPanelColumns);
}

std::string script_text(const Chart& chart) {
  std::string s = fmt::format(
      "# Run `gnuplot {0}.gp` in this folder to draw {0}.svg again.\n"
      "set terminal svg size {1},{2} dynamic rounded font 'Helvetica,15' linewidth 1.4 background "
      "'#ffffff'\n"
      "set output '{0}.svg'\nset encoding utf8\n"
      "set border 3 lc rgb '#555555'\nset tics nomirror textcolor rgb '#333333'\nset grid lc rgb '#e4e4e4' "
      "lt 1 lw 0.6\n"
      "set key outside top center horizontal noenhanced samplen 2\nset xlabel {3}\nset ylabel {4}\n",
      chart.name, chart.wide ? kWideWidth : kWidth, height_of(chart), quoted(chart.x_label),
      quoted(chart.y_label));
  if (chart.log_x) s += "set logscale x\nset format x '%g'\n" + log_tics(chart, 'x');
  if (chart.log_y) s += "set logscale y\nset format y '%g'\n" + log_tics(chart, 'y');
  s += chart.extra;
  if (chart.style == Chart::Style::kPanels) return s + panels_text(chart);
  std::string plot;
  for (std::size_t i = 0; i < chart.series.size(); ++i) {
    const Series& series = chart.series[i];
    if (series.x.empty()) continue;
    const bool marks = chart.style == Chart::Style::kMarks && !series.bars.empty();
    const bool steps = chart.style == Chart::Style::kMarks && series.bars.empty();
    plot += fmt::format(
        "{}'{}.dat' index {} using {} with {}{} lc rgb '{}' {}", plot.empty() ? "plot " : ", \\\n     ",
        chart.name, i, marks ? "1:2:3:4:5:6" : columns_of(chart),
        series.is_truth ? "lines lw 6"
        : marks         ? mark_of(series)
                        : style_name(chart.style),
        dashes(chart, series), series.colour, steps ? "notitle" : "title " + quoted(series.label));
  }
  return s + plot + "\n";
}

/// The XML head goes, and names are made unique within a page.
std::string for_page(std::string svg, const std::string& name) {
  const std::size_t at = svg.find("<svg");
  if (at == std::string::npos) return {};
  svg.erase(0, at);
  const auto replace_all = [&](const std::string& from, const std::string& to) {
    for (std::size_t i = svg.find(from); i != std::string::npos; i = svg.find(from, i + to.size()))
      svg.replace(i, from.size(), to);
  };
  for (const char* id : {"gpDot", "gpPt", "gnuplot_plot_", "textbox"}) {
    for (const char quote : {'\'', '"'}) {
      replace_all(fmt::format("id={}{}", quote, id), fmt::format("id={}{}-{}", quote, name, id));
      replace_all(fmt::format("xlink:href={}#{}", quote, id),
                  fmt::format("xlink:href={}#{}-{}", quote, name, id));
      replace_all(fmt::format(" href={}#{}", quote, id), fmt::format(" href={}#{}-{}", quote, name, id));
    }
  }
  return svg;
}

constexpr const char* kColours[] = {"#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00",
                                    "#56b4e9", "#7f3fbf", "#8c6d31", "#222222"};

/// The renderers' own names: the best known in solid lines.
const std::map<std::string, LineStyle>& known_styles() {
  static const std::map<std::string, LineStyle> kKnown = {{"cloud", {"#0072b2", ""}},
                                                          {"cloud-literal", {"#d55e00", ""}},
                                                          {"mesh-godobject", {"#009e73", ""}},
                                                          {"brute-force", {"#cc79a7", ""}},
                                                          {"analytic", {"#56b4e9", ""}},
                                                          {"heightfield", {"#e69f00", ""}},
                                                          {"mls-proxy", {"#7f3fbf", ""}},
                                                          {"cloud-smooth", {"#8c6d31", ""}},
                                                          {"sphere-proxy", {"#222222", ""}},
                                                          {"sdf-godobject", {"#0072b2", "(10,5)"}},
                                                          {"penalty-grid", {"#d55e00", "(10,5)"}},
                                                          {"vgraph", {"#009e73", "(10,5)"}},
                                                          {"vector-field", {"#cc79a7", "(10,5)"}},
                                                          {"stream-proxy", {"#56b4e9", "(10,5)"}},
                                                          {"heightfield-literal", {"#e69f00", "(10,5)"}},
                                                          {"mls-penalty", {"#7f3fbf", "(10,5)"}},
                                                          {"mesh-proxy", {"#8c6d31", "(10,5)"}},
                                                          {"depth-image", {"#222222", "(10,5)"}},
                                                          {"cloud-vertices", {"#d55e00", "(3,4)"}},
                                                          {"variable-proxy", {"#7f3fbf", "(3,4)"}}};
  return kKnown;
}

/// Styles left for other labels: the colours in dashes that no known renderer has.
std::vector<LineStyle> other_styles() {
  std::vector<LineStyle> all;
  for (const auto& dash : kDashes)
    for (const char* colour : kColours)
      if (std::none_of(known_styles().begin(), known_styles().end(), [&](const auto& known) {
            return known.second.colour == colour && known.second.dash == dash.first;
          }))
        all.push_back({colour, dash.first});
  return all;
}

}  // namespace

std::vector<LineStyle> line_styles_of(const std::vector<std::string>& labels) {
  std::map<std::string, LineStyle> given;
  for (const std::string& label : labels)
    if (const auto known = known_styles().find(label); known != known_styles().end()) given.insert(*known);
  // How many series have it, and how many its colour.
  const auto shared = [&](const LineStyle& style) {
    std::pair<int, int> count;
    for (const auto& [label, other] : given) {
      count.first += other.colour == style.colour && other.dash == style.dash ? 1 : 0;
      count.second += other.colour == style.colour ? 1 : 0;
    }
    return count;
  };
  const std::vector<LineStyle> others = other_styles();
  // In the order of the labels' letters, so that theirs in the document changes nothing.
  for (const std::string& label : std::set<std::string>(labels.begin(), labels.end())) {
    if (given.contains(label)) continue;
    Hash64 hash;
    hash.bytes(std::as_bytes(std::span(label)));
    std::vector<LineStyle> own = others;  // beginning where most figures can give it the same
    std::rotate(own.begin(), own.begin() + static_cast<std::ptrdiff_t>(hash.value() % own.size()), own.end());
    given[label] = *std::min_element(own.begin(), own.end(), [&](const LineStyle& a, const LineStyle& b) {
      return shared(a) < shared(b);
    });
  }
  std::vector<LineStyle> styles;
  for (const std::string& label : labels) styles.push_back(given.at(label));
  return styles;
}

bool has_points(const Chart& chart) {
  return std::any_of(chart.series.begin(), chart.series.end(), [](const Series& series) {
    return std::any_of(series.y.begin(), series.y.end(), [](double y) { return std::isfinite(y); });
  });
}

Figure draw(const Chart& chart, const OutputFolder& folder) {
  Figure figure{chart.name, chart.title, chart.caption, {}, chart.wide};
  if (leaves(chart)) figure.caption += " What leaves a panel runs along its edge.";
  const auto give_up = [&](const std::string& why) {
    figure.caption = kNotDrawn + why;
    return figure;
  };
  if (!has_points(chart)) {
    figure.caption = chart.nothing;
    return figure;
  }
  if (const Status s = folder.write(chart.name + ".dat", data_text(chart)); !s)
    return give_up(s.error().message());
  if (const Status s = folder.write(chart.name + ".gp", script_text(chart)); !s)
    return give_up(s.error().message());
  return drawn_again(std::move(figure), folder);
}

Figure drawn_again(Figure figure, const OutputFolder& folder) {
  figure.svg.clear();
  const auto give_up = [&](const std::string& why) {
    figure.caption = kNotDrawn + why;
    return figure;
  };
  if (const Result<std::string> s = folder.claim(figure.name + ".svg"); !s)
    return give_up(s.error().message());
  const Result<ProcessOutcome> run = run_process(
      {"gnuplot", figure.name + ".gp"}, {.time_limit_s = kGnuplotLimitS, .folder = folder.path().string()});
  if (!run) return give_up(run.error().message());
  if (run->exit_code != 0) return give_up(run->err.empty() ? "gnuplot failed" : run->err);
  const Result<std::string> svg = read_file(folder.file(figure.name + ".svg").string(), kMemoryLimitBytes);
  if (!svg) return give_up(svg.error().message());
  figure.svg = for_page(*svg, figure.name);
  return figure.svg.empty() ? give_up("gnuplot wrote no picture") : figure;
}

}  // namespace palpate::experiments
