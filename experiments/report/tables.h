// Tables as data: the same one is printed on the terminal and set in the report.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

struct Cell {
  std::string text;
  bool best = false;  ///< the best of its row or column
  bool bad = false;   ///< falls short
};

struct Table {
  std::string title;
  std::string caption;
  std::vector<std::string> columns;     ///< the first one heads the rows
  std::vector<std::vector<Cell>> rows;  ///< each as long as `columns`; a row of one cell is a heading
  std::vector<std::string> notes;
};

/// Columns aligned; the best of a row marked with *.
[[nodiscard]] std::string to_text(const Table& table);
[[nodiscard]] std::string to_html(const Table& table);

/// The truth and the oracle of tests are shown beside the renderers but win nothing.
[[nodiscard]] bool competes(const metrics::RendererResult& result);

/// One column per renderer, one row per score.
[[nodiscard]] Table comparison_table(const metrics::ResultDocument& document);

/// Numbers that stand side by side: all with as many decimals as the smallest needs for three digits, or as
/// the largest bears; a dash for nothing, "<0.001" for what would read as nothing and is not.
[[nodiscard]] std::vector<std::string> aligned_numbers(const std::vector<std::optional<double>>& values);
/// The same for times: "ms" or "s", whichever suits the longest, and the numbers in it.
struct AlignedTimes {
  std::string unit;
  std::vector<std::string> texts;
};
[[nodiscard]] AlignedTimes aligned_times(const std::vector<std::optional<double>>& ms);

/// What missed, false and stuck contact mean, a sentence each.
[[nodiscard]] const std::vector<std::string>& contact_words();

/// Three significant digits, thousands separated: 0.0374, 2.40, 1,002,001.
[[nodiscard]] std::string short_number(double value);
[[nodiscard]] std::string short_number(const std::optional<double>& value);  ///< a dash for nothing
[[nodiscard]] std::string count_text(std::uint64_t value);
/// A number with its unit at a readable size: 0.42 ms, 25.1 s.
[[nodiscard]] std::string duration_text(double ms);

/// & < > " ' replaced.
[[nodiscard]] std::string html_escaped(const std::string& text);

}  // namespace palpate::experiments
