// Tables as data: the same one is printed on the terminal and set in the report, and says there what its
// marks mean.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "toolkit/core/messages.h"
#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

struct Cell {
  std::string text;
  bool best = false;   ///< the best of its row or column: marked *
  bool bad = false;    ///< falls short: marked !
  std::string link{};  ///< of a page: where the text leads; empty: nowhere
};

/// Neither marked.
[[nodiscard]] inline Cell plain(std::string text) {
  return {std::move(text), false, false};
}
/// Neither marked.
[[nodiscard]] inline std::vector<Cell> plain_row(std::vector<std::string> texts) {
  std::vector<Cell> row;
  for (std::string& text : texts) row.push_back(plain(std::move(text)));
  return row;
}

struct Table {
  std::string title;
  std::string caption;
  std::vector<std::string> columns;     ///< the first one heads the rows
  std::vector<std::vector<Cell>> rows;  ///< each as long as `columns`; a row of one cell is a heading
  std::vector<std::string> notes;
  /// The columns are alike (renderers) and may become rows where they do not fit, each group of rows a table.
  bool turns = false;
  std::string best_means{};  ///< what * says; empty: the best of its row (of its column in a turned table)
  std::string bad_means{};   ///< what ! says; empty: falls short
};

/// Letters and marks of a terminal, the continuation bytes of UTF-8 not counted.
[[nodiscard]] std::size_t text_width(const std::string& text);
/// Whether most cells of a column are words: they stand left, numbers right.
[[nodiscard]] bool holds_words(const Table& table, std::size_t column);
/// Broken at blanks and after hyphens into lines of at most `columns`; a longer word keeps its line.
[[nodiscard]] std::vector<std::string> wrapped(const std::string& text, std::size_t columns);

/// A group of rows with the columns as rows; `table.turns` is not looked at.
[[nodiscard]] std::vector<Table> turned(const Table& table);
/// The columns from `begin` to `end` behind the first one; legend, caption and notes stay with the whole.
[[nodiscard]] Table part_of(const Table& table, std::size_t begin, std::size_t end);
/// Meanings of the marks that stand in the table: *, !, the dash. One line each, in one text.
[[nodiscard]] std::vector<std::string> legend_of(const Table& table, bool is_turned);

/// Aligned, for a terminal of so many columns: headings and texts are wrapped, a table that may be turned is
/// turned, and what is still too wide goes on below under its first column. Legend, caption and notes follow.
[[nodiscard]] std::string to_text(const Table& table, std::size_t columns);
/// The same for the report: a table that may be turned is turned from some number of columns on.
[[nodiscard]] std::string to_html(const Table& table);

/// The truth and the oracle of tests are shown beside the renderers but win nothing.
[[nodiscard]] bool competes(const metrics::RendererResult& result);

/// Rounding of a score (see metrics::Accuracy::rounding_n), and the score, or 0 where it is no more than
/// that.
[[nodiscard]] double rounding_of(const metrics::RendererResult& result,
                                 std::optional<double> metrics::Accuracy::*score);
[[nodiscard]] std::optional<double> settled_score(const metrics::RendererResult& result,
                                                  std::optional<double> metrics::Accuracy::*score);

/// "0.115 to 0.121", or a dash.
[[nodiscard]] std::string interval_text(const std::optional<Interval>& interval);
/// Neither can be told from the other: both known, and one does not end before the other begins.
[[nodiscard]] bool overlap(const std::optional<Interval>& a, const std::optional<Interval>& b);

/// A part of what was prepared came from a cache: its time is no measurement of today, and wins nothing.
[[nodiscard]] bool prepared_from_cache(const metrics::RendererResult& result);
/// "1.92 s", "41.0 s (from the cache)", or a dash.
[[nodiscard]] std::string preparation_text(const metrics::RendererResult& result);

/// A value of a renderer, where it has one.
using ScoreGet = std::function<std::optional<double>(const metrics::RendererResult&)>;
[[nodiscard]] ScoreGet frame_score(std::optional<trace::FrameStatistics> metrics::RendererResult::*set,
                                   std::optional<double> trace::FrameStatistics::*member);
template <class Count>  // std::uint64_t or double, or an optional one
[[nodiscard]] ScoreGet accuracy_score(Count metrics::Accuracy::*member) {
  return [member](const metrics::RendererResult& r) -> std::optional<double> {
    if (!r.accuracy) return std::nullopt;
    const auto value = std::optional((*r.accuracy).*member);
    return value ? std::optional(static_cast<double>(*value)) : std::nullopt;
  };
}
[[nodiscard]] std::optional<double> prepare_ms(const metrics::RendererResult& result);
[[nodiscard]] std::optional<double> bytes_a_point(const metrics::RendererResult& result);

/// Notation of a row's numbers.
enum class Show { kNumbers, kCounts, kTimes };
/// A name and the values of every renderer, written alike; of times the name says the unit. A value that is
/// not finite is none.
[[nodiscard]] std::vector<Cell> score_row(std::string name, const std::vector<std::optional<double>>& values,
                                          Show show);

/// One column per renderer, one row per score.
[[nodiscard]] Table comparison_table(const metrics::ResultDocument& document);

/// "of 50,000" where all renderers have run as many frames, else nothing.
[[nodiscard]] std::string frames_text(const metrics::ResultDocument& document);

/// Meanings of missed, false and stuck contact, a sentence each.
[[nodiscard]] const std::vector<std::string>& contact_words();

/// & < > " ' replaced.
[[nodiscard]] std::string html_escaped(const std::string& text);

}  // namespace palpate::experiments
