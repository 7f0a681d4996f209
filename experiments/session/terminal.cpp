#include "experiments/session/terminal.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <string_view>

#include "experiments/report/findings.h"

namespace palpate::experiments {

std::size_t terminal_columns(int descriptor) {
  constexpr std::size_t kDefault = 80, kMost = 10'000;
  if (const char* const set = std::getenv("COLUMNS"); set != nullptr) {
    const std::string_view text(set);
    std::size_t columns = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), columns);
    if (error == std::errc() && end == text.data() + text.size() && columns > 0 && columns <= kMost)
      return columns;
  }
  winsize size{};
  if (::ioctl(descriptor, TIOCGWINSZ, &size) == 0 && size.ws_col > 0) return size.ws_col;
  return kDefault;
}

void print_tables(const std::vector<Table>& tables, bool whole) {
  std::string text;
  for (const Table& table : tables) text += to_text(table, terminal_columns(STDOUT_FILENO)) + "\n";
  if (whole || tables.empty()) return fmt::print("{}", text);
  // What stands below a table explains it: in the report it does too.
  const std::size_t lines = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
  text.erase(0, text.find_first_not_of('\n'));
  std::size_t at = 0, kept = 0;
  for (; kept < kBriefLines && at < text.size() && text[at] != '\n'; ++kept) at = text.find('\n', at) + 1;
  fmt::print("{}", text.substr(0, at));
  if (kept < lines) fmt::print("{} lines more: --verbose, or the report\n", lines - kept);
}

void print_scores(const metrics::ResultDocument& document, bool whole) {
  if (whole) print_tables({comparison_table(document)}, true);
  Table table = summary_table(document, SummaryFor::kTerminal);
  constexpr std::size_t kMostRows = 6;
  const std::size_t rows = table.rows.size(), shown = std::min(rows, kMostRows);
  if (!whole) table.rows.resize(shown);
  fmt::print("{}\n", to_text(table, terminal_columns(STDOUT_FILENO)));
  if (!whole && shown < rows) fmt::print("{} more: --verbose, or the report\n", rows - shown);
  const Headline answer = answer_of(document);
  for (const std::string& line : wrapped(answer.lead + (answer.lead == "Take" ? " " : ": ") + answer.text,
                                         terminal_columns(STDOUT_FILENO)))
    fmt::print("{}\n", line);
}

}  // namespace palpate::experiments
