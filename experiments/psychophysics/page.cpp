#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/psychophysics/blinded.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments::psychophysics {
namespace {

constexpr double kUsPerMsShown = 1e3;

std::string percent(double share) {
  return fmt::format("{:.1f} %", 100.0 * share);
}

std::string p_text(double p) {
  constexpr double kLeastShown = 0.0001;
  return p < kLeastShown ? "<0.0001" : fmt::format("{:.4f}", p);
}

std::string from_to(const Interval& interval, const std::string& unit) {
  const auto text = format_aligned({interval.low, interval.high});
  return fmt::format("{} to {}{}{}", text[0], text[1], unit.empty() ? "" : " ", unit);
}

std::string needed_text(const std::optional<Needed>& needed) {
  if (!needed) return fmt::format("over {}", format_count(kMostTrials));
  if (needed->first == needed->safe) return format_count(needed->first);
  return fmt::format("{}; every number from {}", format_count(needed->first), format_count(needed->safe));
}

void add_row(Table& table, std::string what, std::string value, std::string interval = kMissingNumber) {
  table.rows.push_back({{std::move(what)}, {std::move(value)}, {std::move(interval)}});
}

/// A d' at the end of the search range is no measured number.
std::string dprime_interval(const Sensitivity& found) {
  if (!found.has_interval) return kMissingNumber;
  const Interval& i = found.dprime.interval;
  if (i.high < kLargestDprime - 1e-3) return from_to(i, {});
  return "above " + format_number(i.low);
}

Table difference_table(const Plan& plan, const Difference& d) {
  Table table;
  table.title = plan.title;
  table.columns = {"of the answers", "is", "95 % interval"};
  add_row(table, "right", fmt::format("{} of {}", d.answers.correct(), d.answers.trials()));
  add_row(table, "share of right answers", percent(d.share.value),
          fmt::format("{} to {}", percent(d.share.interval.low), percent(d.share.interval.high)));
  add_row(table, "p of so many by chance", p_text(d.p));
  if (d.differencing)
    add_row(table, d.independent ? "d', differencing" : "d'", format_number(d.differencing->dprime.value),
            dprime_interval(*d.differencing));
  if (d.independent)
    add_row(table, "d', independent observations", format_number(d.independent->dprime.value),
            dprime_interval(*d.independent));
  if (d.differencing && d.differencing->criterion)
    add_row(table, "criterion, deviations", fmt::format("{:.2f}", *d.differencing->criterion));
  add_row(table, fmt::format("told apart in under {}: p", percent(plan.power.equivalence)),
          p_text(d.equivalence_p));
  const bool differs = d.p <= plan.power.alpha, alike = d.equivalence_p <= plan.power.alpha;
  table.notes.push_back(
      differs && alike ? "They are told apart, and in fewer trials than the bound."
      : differs        ? "They are told apart."
      : alike ? fmt::format("They are told apart in under {}: a difference as large as that was looked for "
                            "and is not there.",
                            percent(plan.power.equivalence))
              : "Neither a difference nor its absence is shown: a missed difference proves nothing.");
  return table;
}

Table threshold_table(const Plan& plan, const Threshold& t) {
  const std::string& unit = plan.option->unit;
  Table table;
  table.title = plan.title;
  table.columns = {fmt::format("of {}", plan.option->key), "is", "95 % interval"};
  add_row(table, "JND: three of four right", fmt::format("{} {}", format_number(t.jnd.value), unit),
          from_to(t.jnd.interval, unit));
  const double standard = plan.option->standard;
  add_row(table, fmt::format("of the standard, {:g} {}", standard, unit), percent(t.jnd.value / standard),
          fmt::format("{} to {}", percent(t.jnd.interval.low / standard),
                      percent(t.jnd.interval.high / standard)));
  if (t.procedure)
    add_row(table, t.procedure_says, fmt::format("{} {}", format_number(t.procedure->value), unit),
            t.procedure->interval.high > t.procedure->interval.low ? from_to(t.procedure->interval, unit)
                                                                   : std::string(kMissingNumber));
  add_row(table, "slope", format_number(t.fit.function.slope));
  add_row(table, "deviance", format_number(t.fit.deviance));
  table.notes.push_back("By " + t.method + ".");
  return table;
}

Table trials_table(const Analysis& a) {
  Table table;
  table.title = "Trials";
  table.columns = {"trials", "number"};
  const auto row = [&](const char* what, std::string text) {
    table.rows.push_back({{what}, {std::move(text)}});
  };
  row("that count", format_count(a.main));
  row("practice", format_count(a.practice));
  row("catch, right", fmt::format("{} of {}", a.catches_right, a.catches));
  row("excluded by the plan's rule", format_count(a.excluded));
  return table;
}

Table sessions_table(const std::vector<SessionRecord>& sessions) {
  Table table;
  table.title = "Sessions at the device";
  table.columns = {"begun", "trials", "ticks", "missed", "late, 999 of 1,000 below", "latest", "begun anew"};
  for (const SessionRecord& s : sessions) {
    const bool any = s.last_trial > 0;
    table.rows.push_back({{s.started_utc},
                          {any ? fmt::format("{} to {}", s.first_trial, s.last_trial) : kMissingNumber},
                          {format_count(s.ticks)},
                          {format_count(s.missed)},
                          {format_duration(s.late_p999_us / kUsPerMsShown)},
                          {format_duration(s.late_most_us / kUsPerMsShown)},
                          {format_count(s.begun_again)}});
    table.notes.push_back(fmt::format("{}: {:g} Hz, {}, {}.", s.started_utc, s.rate_hz,
                                      s.real_time ? "real time" : "virtual time, as fast as it goes",
                                      s.scheduling));
    table.notes.push_back(fmt::format("Every renderer was stepped in {} of {} frames of its trials.",
                                      format_count(s.whole_frames), format_count(s.trial_frames)));
    for (const std::string& note : s.notes) table.notes.push_back(note);
  }
  return table;
}

std::string described(const ObservedDocument& document) {
  const Plan& p = document.plan;
  const std::string what = p.compares() ? fmt::format("A is {}, B is {}", p.a, p.b)
                                        : fmt::format("A is {} with {} = {:g} {}, B the same with {} of it",
                                                      p.option->renderer, p.option->key, p.option->standard,
                                                      p.option->unit, p.option->upwards ? "more" : "less");
  return fmt::format("Task {}, procedure {}, on {}. {}. Observer {}, participant {}, seed {}.",
                     name_of(p.task), name_of(p.procedure), p.scene, what, document.observer.text,
                     p.participant, p.seed);
}

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

/// Charts by kind of study. A varied option: psychometric function, and an adaptive procedure's course.
/// Compared renderers: running share of right answers with its exact interval.
std::vector<Chart> charts_of(const ObservedDocument& document) {
  if (!document.analysis.threshold) return {share_chart(document)};
  const Threshold& t = *document.analysis.threshold;
  std::vector<Chart> charts = {function_chart(document.plan, t)};
  if (document.plan.procedure != ProcedureKind::kFixed) charts.push_back(course_chart(document, t));
  return charts;
}

}  // namespace

Table power_table(const Plan& plan) {
  const PowerWish& w = plan.power;
  Table table;
  table.title = "Before anybody is asked";
  table.columns = {fmt::format("at power {:g}, error {:g}", w.wanted, w.alpha), "trials"};
  table.rows.push_back({{fmt::format("to find what is right in {} of trials", percent(w.detect))},
                        {needed_text(trials_for_difference(w.detect, w.wanted, w.alpha))}});
  table.rows.push_back({{fmt::format("to show that it is right in under {}", percent(w.equivalence))},
                        {needed_text(trials_for_equivalence(w.equivalence, w.wanted, w.alpha))}});
  if (plan.procedure == ProcedureKind::kFixed) {
    const std::uint64_t n = Course::fixed_trials(plan);
    table.rows.push_back(
        {{plan.compares() ? "the plan has" : "the plan has, over all differences"}, {format_count(n)}});
    if (plan.compares()) {
      const std::optional<double> bound = shown_bound(n, w.wanted, w.alpha);
      table.notes.push_back(fmt::format(
          "With {} trials a share of {} is found with power {:.2f}; and where nothing is felt, \"told apart "
          "in under {}\" is "
          "what they show. A difference that is missed proves no more than that.",
          n, percent(w.detect), difference_power(n, w.detect, w.alpha), bound ? percent(*bound) : "100 %"));
      if (difference_power(n, w.detect, w.alpha) < w.wanted)
        table.notes.emplace_back("These are too few for the wanted power.");
    }
  }
  return table;
}

std::vector<Table> observed_tables(const ObservedDocument& document) {
  std::vector<Table> tables;
  if (document.analysis.difference)
    tables.push_back(difference_table(document.plan, *document.analysis.difference));
  if (document.analysis.threshold)
    tables.push_back(threshold_table(document.plan, *document.analysis.threshold));
  tables.push_back(trials_table(document.analysis));
  if (!document.sessions.empty()) tables.push_back(sessions_table(document.sessions));
  return tables;
}

std::string r_snippet(const Plan& plan) {
  const std::string begin =
      "d <- read.csv(\"trials.csv\")\n"
      "d <- d[d$kind == \"main\" & (is.na(d$excluded) | d$excluded == \"\"), ]\n";
  if (plan.compares()) return begin + "print(binom.test(sum(d$correct), nrow(d), 0.5))\n";
  return begin +
         "s <- aggregate(correct ~ level, d, function(x) c(right = sum(x), of = length(x)))\nprint(s)\n"
         "plot(s$level, s$correct[, \"right\"] / s$correct[, \"of\"], log = \"x\", ylim = c(0, 1))\n";
}

std::string python_snippet(const Plan& plan) {
  const std::string begin =
      "import csv\n"
      "with open(\"trials.csv\", newline=\"\") as file:\n"
      "    rows = [r for r in csv.DictReader(file) if r[\"kind\"] == \"main\" and not r[\"excluded\"]]\n";
  if (plan.compares())
    return begin + "print(sum(int(r[\"correct\"]) for r in rows), \"right of\", len(rows))\n";
  return begin +
         "levels = {}\n"
         "for r in rows:\n"
         "    levels.setdefault(float(r[\"level\"]), []).append(int(r[\"correct\"]))\n"
         "for level, right in sorted(levels.items()):\n"
         "    print(level, sum(right), \"right of\", len(right))\n";
}

Page observed_page(const ObservedDocument& document, const OutputFolder& folder) {
  Page page = begin_page(document.plan.title, document.head);
  add_known(page, {{}, document.analysis.warnings, document.notes});
  Section section;
  section.id = "found";
  section.title = "Findings";
  section.paragraphs.push_back(described(document));
  section.tables = observed_tables(document);
  section.tables.push_back(power_table(document.plan));
  if (const Result<OutputFolder> figures = folder.inside("figures"))
    for (const Chart& chart : charts_of(document)) section.figures.push_back(draw(chart, *figures));
  page.sections.push_back(std::move(section));
  Section reading;
  reading.id = "read";
  reading.title = "Read the trials";
  reading.opening =
      "<p>trials.csv holds a row for each trial, study.json units and meaning of its columns. read.R and "
      "read.py "
      "stand beside them:</p>\n";
  // Line breaks of the scripts are kept.
  for (const auto& [name, text] :
       {std::pair{"read.R", r_snippet(document.plan)}, {"read.py", python_snippet(document.plan)}})
    reading.opening += fmt::format("<h3>{}</h3>\n<pre>{}</pre>\n", name, html_escaped(text));
  page.sections.push_back(std::move(reading));
  return page;
}

}  // namespace palpate::experiments::psychophysics
