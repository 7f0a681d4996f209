// The first page of `palpate reproduce`: whether the thesis is reproduced, whom to take, a line a table.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "experiments/tables/reproduction.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

/// Number of the judged ones that are so.
struct Share {
  std::size_t yes = 0, all = 0;

  [[nodiscard]] std::string text() const {
    return yes == all ? fmt::format("all {}", all) : fmt::format("{} of {}", yes, all);
  }
  [[nodiscard]] const char* verdict() const {
    return yes == all ? "are reproduced" : yes > 0 ? "are reproduced in part" : "are not reproduced";
  }
};

Share share_of(const std::vector<Answer>& answers, Judged Answer::*what) {
  Share share;
  for (const Answer& answer : answers) {
    share.yes += answer.*what == Judged::kYes ? 1u : 0u;
    share.all += answer.*what != Judged::kNot ? 1u : 0u;
  }
  return share;
}

std::string times_text(double ratio) {
  return format_number(ratio) + " times";
}

std::string reproduced_text(const std::vector<Answer>& answers) {
  const Share fast = share_of(answers, &Answer::as_fast), literal = share_of(answers, &Answer::literal_right),
              ours = share_of(answers, &Answer::ours_right), whole = share_of(answers, &Answer::reproduced);
  if (whole.all == 0) return "Not judged: nothing of the printed size was measured.";
  if (whole.all == 1) {
    const auto one = std::find_if(answers.begin(), answers.end(),
                                  [](const Answer& answer) { return answer.reproduced != Judged::kNot; });
    const std::string faster =
        one->ratio > 0.0 ? fmt::format(", ours {} faster", times_text(one->ratio)) : "";
    return fmt::format("Table {} alone was measured at its size: {}{}.", one->table, one->status, faster);
  }
  std::vector<std::string> parts;
  if (fast.all > 0) {
    double least = HUGE_VAL, most = 0.0;
    for (const Answer& answer : answers) {
      if (!(answer.ratio > 0.0)) continue;
      least = std::min(least, answer.ratio);
      most = std::max(most, answer.ratio);
    }
    parts.push_back(fmt::format("Its times {}: {} are as short as printed or shorter, ours by {} to {}.",
                                fast.verdict(), fast.text(), format_number(least), times_text(most)));
  }
  if (literal.all > 0)
    parts.push_back(fmt::format("Its contact is right in {} tables with the algorithm as printed{}.",
                                literal.text(),
                                ours.all > 0 ? fmt::format(", in {} made right", ours.text()) : ""));
  parts.push_back(fmt::format("Of the lines below {} are reproduced whole.", whole.text()));
  return joined(parts, " ");
}

/// "cloud-smooth (table 7), cloud (tables 8, 9)".
std::string taken_text(const std::vector<Answer>& answers) {
  std::vector<std::pair<std::string, std::vector<std::string>>> taken;
  for (const Answer& answer : answers) {
    if (answer.take.empty()) continue;
    auto same =
        std::find_if(taken.begin(), taken.end(), [&](const auto& t) { return t.first == answer.take; });
    if (same == taken.end()) same = taken.insert(taken.end(), {answer.take, {}});
    same->second.push_back(answer.table);
  }
  std::vector<std::string> parts;
  for (const auto& [label, tables] : taken)
    parts.push_back(fmt::format("{} (table{} {})", label, tables.size() == 1 ? "" : "s", joined(tables)));
  return joined(parts);
}

/// The first page's table.
Table answers_table(const std::vector<Answer>& answers) {
  Table table;
  table.columns = {"table",  "what it says", "thesis",   "as printed, here", "made right, here",
                   "faster", "force error",  "a mesh's", "reproduced"};
  const auto or_dash = [](const std::string& text) { return plain(text.empty() ? kMissingNumber : text); };
  for (const Answer& a : answers) {
    std::vector<Cell> row = {plain(a.table), plain(a.says)};
    row.front().link = a.page;
    for (const std::string& text : {a.printed, a.literal, a.ours}) row.push_back(or_dash(text));
    row.push_back(or_dash(a.ratio > 0.0 ? times_text(a.ratio) : ""));
    for (const std::string& text : {a.error, a.mesh_error}) row.push_back(or_dash(text));
    row.push_back({a.status, a.reproduced == Judged::kYes,
                   a.reproduced == Judged::kNo && !a.status.starts_with("in part")});
    table.rows.push_back(std::move(row));
  }
  table.best_means = "reproduced";
  table.bad_means = "not reproduced";
  table.caption =
      "Thesis: the printed value and its hardware. As printed: the thesis's algorithm with its parameters. "
      "Made right: the first of ours. Faster: the printed time by that of ours. Force error: RMS, of ours "
      "and "
      "of a mesh of the same points. A table's number leads to its page.";
  return table;
}

}  // namespace

std::vector<Headline> verdicts_of(const std::vector<Answer>& answers) {
  std::vector<Headline> verdicts;
  if (answers.empty()) return verdicts;
  verdicts.push_back({"The thesis", reproduced_text(answers)});
  if (const std::string taken = taken_text(answers); !taken.empty())
    verdicts.push_back(
        {"Take", taken + ": its contact is right, none is told to be more accurate, and of equals it is "
                         "the fastest."});
  return verdicts;
}

Page page_of(const metrics::DocumentHead& head, const std::vector<Part>& parts) {
  Page page = begin_page(kReproductionTitle, head);
  page.apart = true;
  std::vector<Answer> answers;
  HeadlineGroup missing{"Not done", {}};
  for (const Part& part : parts) {
    page.known.insert(page.known.end(), part.known.begin(), part.known.end());
    page.sections.insert(page.sections.end(), part.sections.begin(), part.sections.end());
    answers.insert(answers.end(), part.answers.begin(), part.answers.end());
    for (const std::string& what : part.missing) {
      const std::size_t colon = what.find(": ");
      const bool whole = colon == std::string::npos;
      missing.lines.push_back({whole ? "" : what.substr(0, colon), whole ? what : what.substr(colon + 2)});
    }
  }
  page.answers = verdicts_of(answers);
  if (!answers.empty()) page.tables = {answers_table(answers)};
  if (!missing.lines.empty()) page.headlines = {std::move(missing)};
  // The picture of the trade is that of the first table that has one.
  for (const Section& section : page.sections)
    for (const Figure& figure : section.figures)
      if (page.figures.empty() && figure.name == section.id + kTradeSuffix && !figure.svg.empty()) {
        page.figures = {figure};
        page.figures.front().title += ": " + section.title;
      }
  page.commands.push_back("palpate reproduce --help    # shorter and longer runs");
  return page;
}

}  // namespace palpate::experiments
