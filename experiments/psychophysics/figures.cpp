#include "experiments/psychophysics/figures.h"

#include <fmt/format.h>

#include <algorithm>

#include "toolkit/core/number_format.h"

namespace palpate::experiments::psychophysics {
namespace {

constexpr const char* kDotColour = "#0072b2";
constexpr const char* kLineColour = "#9a9a9a";
constexpr const char* kMarkColour = "#d55e00";
constexpr const char* kRightAxis = "set yrange [0:1.02]\n";
constexpr int kCurvePoints = 400;

Chart function_chart(const Plan& plan, const Threshold& t) {
  Chart chart;
  chart.name = "function";
  chart.title = "Share of right answers";
  chart.x_label = fmt::format("difference of {}, {}", plan.option->key, plan.option->unit);
  chart.y_label = "share of right answers";
  chart.style = Chart::Style::kMarks;
  chart.wide = true;
  chart.extra = kRightAxis;
  chart.caption = fmt::format(
      "Points: shares with their exact intervals, long where few trials were. Grey line: the fitted "
      "function. The JND is {} {} ({} to "
      "{}), "
      "where "
      "three of four answers are right.",
      format_number(t.jnd.value), plan.option->unit, format_number(t.jnd.interval.low),
      format_number(t.jnd.interval.high));
  const double end = 1.1 * std::max(t.levels.back().level, t.jnd.interval.high);
  Series curve{"fitted", kLineColour, {}, {}};
  curve.is_truth = true;
  for (int i = 0; i <= kCurvePoints; ++i) {
    curve.x.push_back(end * i / kCurvePoints);
    curve.y.push_back(t.fit.function.proportion(curve.x.back()));
  }
  Series shares{"answers", kDotColour, {}, {}};
  for (const LevelAnswers& one : t.levels) {
    const Interval interval = clopper_pearson(one.trials, one.correct);
    shares.x.push_back(one.level);
    shares.y.push_back(static_cast<double>(one.correct) / static_cast<double>(one.trials));
    shares.bars.push_back({one.level, one.level, interval.low, interval.high});
  }
  Series jnd{"JND with its interval", kMarkColour, {t.jnd.value}, {0.75}, "(3,4)"};
  jnd.bars.push_back({t.jnd.interval.low, t.jnd.interval.high, 0.75, 0.75});
  chart.series = {std::move(curve), std::move(shares), std::move(jnd)};
  return chart;
}

Chart course_chart(const ObservedDocument& document, const Threshold& t) {
  Chart chart;
  chart.name = "course";
  chart.title = "Course of the procedure";
  chart.x_label = "trial that counts";
  chart.y_label = fmt::format("difference, {}", document.plan.option->unit);
  chart.style = Chart::Style::kMarks;
  chart.wide = true;
  chart.log_y = true;
  chart.caption =
      "Every trial that counts: its difference, by whether the answer was right. Grey line: the JND.";
  Series right{"right", kDotColour, {}, {}}, wrong{"wrong", kMarkColour, {}, {}, "(3,4)"};
  Series jnd{"JND", kLineColour, {}, {}};
  jnd.is_truth = true;
  double at = 0.0;
  for (const Row& row : document.rows) {
    if (row.trial.kind != TrialKind::kMain || !row.excluded.empty()) continue;
    at += 1.0;
    Series& series = row.correct() ? right : wrong;
    series.x.push_back(at);
    series.y.push_back(row.trial.level);
    series.bars.push_back({at, at, row.trial.level, row.trial.level});
  }
  jnd.x = {1.0, at};
  jnd.y = {t.jnd.value, t.jnd.value};
  chart.series = {std::move(jnd), std::move(right), std::move(wrong)};
  return chart;
}

Chart share_chart(const ObservedDocument& document) {
  Chart chart;
  chart.name = "share";
  chart.title = "Right answers as trials go on";
  chart.x_label = "trial that counts";
  chart.y_label = "share of right answers";
  chart.wide = true;
  chart.extra = "set yrange [0:1.02]\n";
  chart.caption =
      "The share of right answers so far, with its exact interval. What counts is the end alone: an interval "
      "that was "
      "looked at on the way and stopped at will is not one of 95 %.";
  Series share{"right so far", kDotColour, {}, {}}, low{"lower end of 95 %", kMarkColour, {}, {}, "(10,5)"},
      high{"upper end of 95 %", kMarkColour, {}, {}, "(10,5)"},
      chance{"chance", kLineColour, {}, {}, "(3,4)"};
  std::uint64_t n = 0, k = 0;
  for (const Row& row : document.rows) {
    if (row.trial.kind != TrialKind::kMain || !row.excluded.empty()) continue;
    ++n;
    k += row.correct() ? 1u : 0u;
    const Interval interval = clopper_pearson(n, k);
    const auto x = static_cast<double>(n);
    for (Series* one : {&share, &low, &high, &chance}) one->x.push_back(x);
    share.y.push_back(static_cast<double>(k) / x);
    low.y.push_back(interval.low);
    high.y.push_back(interval.high);
    chance.y.push_back(kChance);
  }
  chart.series = {std::move(chance), std::move(low), std::move(high), std::move(share)};
  return chart;
}

}  // namespace

std::vector<Chart> charts_of(const ObservedDocument& document) {
  if (!document.analysis.threshold) return {share_chart(document)};
  const Threshold& t = *document.analysis.threshold;
  std::vector<Chart> charts = {function_chart(document.plan, t)};
  if (document.plan.procedure != ProcedureKind::kFixed) charts.push_back(course_chart(document, t));
  return charts;
}

}  // namespace palpate::experiments::psychophysics
