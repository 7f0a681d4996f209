// Charts through gnuplot.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

#include "experiments/data/process.h"
#include "experiments/report/figures.h"

namespace palpate::experiments {
namespace {

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
      text += std::isfinite(s.y[i]) ? fmt::format("{:.7g} {:.7g}\n", s.x[i], s.y[i]) : "NaN NaN\n";
    if (s.x.empty()) text += "NaN NaN\n";
    text += "\n\n";
  }
  return text;
}

const char* style_name(Chart::Style style, std::size_t index) {
  switch (style) {
    case Chart::Style::kLines:
      return "lines lw 1.4";
    case Chart::Style::kSteps:
      return "steps lw 1.2";
    case Chart::Style::kMarkedLines:
      return "linespoints pt 7 ps 0.6 lw 1.6";
    case Chart::Style::kBars:
      return "boxxyerror fs solid 0.9 noborder";
    case Chart::Style::kPanels:
      return "lines lw 1.6";
    case Chart::Style::kMap:
      return index == 0 ? "lines lw 0.6" : "lines lw 4";
  }
  return "lines";
}

/// Lines on top of each other are told apart by their dashes, in print as well.
const char* dashes(const Chart& chart, const Series& series) {
  const bool drawn = chart.style == Chart::Style::kLines || chart.style == Chart::Style::kMarkedLines;
  if (!drawn || series.label == "truth") return "";
  return series.label == "mesh-godobject" ? " dt (8,6)" : "";
}

std::string columns_of(const Chart& chart) {
  constexpr double kHalfBar = 0.32;
  if (chart.style != Chart::Style::kBars) return "1:2";
  return fmt::format("1:2:({0:.7g}):1:($2-{1}):($2+{1})", chart.bars_from, kHalfBar);
}

constexpr std::size_t kPanelColumns = 4;
constexpr int kPanelHeight = 180;
constexpr double kSpareRoom = 0.6, kFlatRoom = 0.2, kPanelTics = 4.0;

/// All on the same axes, so that they can be compared; only the outer ones have labels.
std::string panels_text(const Chart& chart) {
  const std::size_t panels = chart.series.size() - 1;
  const std::size_t rows = (panels + kPanelColumns - 1) / kPanelColumns;
  double low = 0.0, high = 0.0;
  for (const double y : chart.series.front().y) {
    low = std::min(low, y);
    high = std::max(high, y);
  }
  // The truth and as much again: what leaves that has left it.
  const double room = high > low ? high - low : kFlatRoom;
  const std::vector<double>& x = chart.series.front().x;
  const double tics = x.empty() ? 1.0 : tic_step(x.back() - x.front(), kPanelTics);
  std::string s = fmt::format(
      "unset key\nset xlabel ''\nset ylabel ''\nset yrange [{:.6g}:{:.6g}]\nset xtics {:.6g}\nset ytics "
      "{:.6g}\n"
      "set multiplot layout {},{} margins char 6, char 2, char 2.5, char 2 spacing char 4.5, char 4.5\n",
      low - kSpareRoom * room, high + kSpareRoom * room, tics,
      tic_step((1.0 + 2.0 * kSpareRoom) * room, kPanelTics), rows, kPanelColumns);
  for (std::size_t i = 1; i < chart.series.size(); ++i)
    s += fmt::format(
        "set title {0} noenhanced offset 0,-0.6 font ',13'\n"
        "plot '{1}.dat' index 0 using 1:2 with lines lw 5 lc rgb '{2}', '{1}.dat' index {3} using 1:2 with "
        "{4} "
        "lc rgb '{5}'\n",
        quoted(chart.series[i].label), chart.name, chart.series.front().colour, i, style_name(chart.style, i),
        chart.series[i].colour);
  return s + "unset multiplot\n";
}

int height_of(const Chart& chart) {
  if (chart.style != Chart::Style::kPanels) return chart.height > 0 ? chart.height : kHeight;
  const std::size_t panels = std::max<std::size_t>(chart.series.size(), 2) - 1;
  return kPanelHeight * static_cast<int>((panels + kPanelColumns - 1) / kPanelColumns);
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
  if (chart.log_x) s += "set logscale x\nset format x '%g'\n";
  if (chart.log_y) s += "set logscale y\nset format y '%g'\n";
  s += chart.extra;
  if (chart.style == Chart::Style::kPanels) return s + panels_text(chart);
  std::string plot;
  for (std::size_t i = 0; i < chart.series.size(); ++i) {
    const Series& series = chart.series[i];
    if (series.x.empty()) continue;
    const bool truth = series.label == "truth";
    plot += fmt::format("{}'{}.dat' index {} using {} with {}{} lc rgb '{}' title {}",
                        plot.empty() ? "plot " : ", \\\n     ", chart.name, i, columns_of(chart),
                        truth ? "lines lw 6" : style_name(chart.style, i), dashes(chart, series),
                        series.colour, quoted(series.label));
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

}  // namespace

std::string colour_of(const std::string& label, std::size_t index) {
  static const std::vector<std::pair<std::string, std::string>> known = {{"cloud", "#0072b2"},
                                                                         {"cloud-literal", "#d55e00"},
                                                                         {"mesh-godobject", "#009e73"},
                                                                         {"brute-force", "#cc79a7"},
                                                                         {"analytic", "#56b4e9"}};
  for (const auto& [name, colour] : known)
    if (name == label) return colour;
  static const std::vector<std::string> others = {"#cc79a7", "#e69f00", "#56b4e9",
                                                  "#7f3fbf", "#8c6d31", "#666666"};
  return others[index % others.size()];
}

double tic_step(double extent, double tics) {
  constexpr double kTen = 10.0, kFive = 5.0;
  if (!(extent > 0.0)) return 1.0;
  const double raw = extent / tics, power = std::pow(kTen, std::floor(std::log10(raw)));
  return raw / power < 2.0 ? 2.0 * power : raw / power < kFive ? kFive * power : kTen * power;
}

Figure draw(const Chart& chart, const OutputFolder& folder) {
  Figure figure{chart.name, chart.title, chart.caption, {}, chart.wide};
  const auto give_up = [&](const std::string& why) {
    figure.caption = "This figure could not be drawn: " + why;
    return figure;
  };
  if (const Status s = folder.write(chart.name + ".dat", data_text(chart)); !s)
    return give_up(s.error().message());
  if (const Status s = folder.write(chart.name + ".gp", script_text(chart)); !s)
    return give_up(s.error().message());
  const Result<ProcessOutcome> run =
      run_process({"gnuplot", chart.name + ".gp"}, kGnuplotLimitS, {}, folder.path().string());
  if (!run) return give_up(run.error().message());
  if (run->exit_code != 0) return give_up(run->err.empty() ? "gnuplot failed" : run->err);
  std::ifstream file(folder.file(chart.name + ".svg"), std::ios::binary);
  std::ostringstream svg;
  svg << file.rdbuf();
  figure.svg = for_page(svg.str(), chart.name);
  return figure.svg.empty() ? give_up("gnuplot wrote no picture") : figure;
}

}  // namespace palpate::experiments
