#include "experiments/session/terminal.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include <palpate/clock.h>
#include "toolkit/core/messages.h"

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
  // Text below a table explains it: in the report it does too.
  const std::size_t lines = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
  text.erase(0, text.find_first_not_of('\n'));
  std::size_t at = 0, kept = 0;
  for (; kept < kBriefLines && at < text.size() && text[at] != '\n'; ++kept) at = text.find('\n', at) + 1;
  fmt::print("{}", text.substr(0, at));
  if (kept < lines) fmt::print("{} lines more: --verbose, or the report\n", lines - kept);
}

void tell_lines(const std::vector<std::string>& lines, bool all) {
  // With a table's kBriefLines, the line on what it leaves out and the report's they are fifteen at most.
  constexpr std::size_t kToldLines = 3;
  const std::size_t told = all || lines.size() <= kToldLines ? lines.size() : kToldLines - 1;
  for (std::size_t i = 0; i < told; ++i) tell("palpate: {}\n", lines[i]);
  if (told < lines.size()) tell("palpate: {} more: --verbose, or the report\n", lines.size() - told);
}

void print_answer(const Headline& answer) {
  for (const std::string& line : wrapped(answer.lead + (answer.lead == "Take" ? " " : ": ") + answer.text,
                                         terminal_columns(STDOUT_FILENO)))
    fmt::print("{}\n", line);
}

namespace {

/// With a line on what is left out, the finding and the report's: 15.
constexpr std::ptrdiff_t kScoreLines = 9;

/// Without what each renderer is and without marks, whose legend takes lines; of several faults the first.
void shorten(Table& table) {
  table.columns.erase(table.columns.begin() + 1);
  for (std::vector<Cell>& row : table.rows) {
    row.erase(row.begin() + 1);
    for (Cell& cell : row) {
      cell.best = cell.bad = false;
      if (const std::size_t end = cell.text.find(", "); end != std::string::npos)
        cell.text.replace(end, std::string::npos, ", ..");
    }
  }
}

}  // namespace

void print_scores(const metrics::ResultDocument& document, bool whole) {
  if (whole) print_tables({comparison_table(document)}, true);
  Table table = summary_table(document);
  const std::size_t rows = table.rows.size(), columns = terminal_columns(STDOUT_FILENO);
  if (!whole) shorten(table);
  std::string text = to_text(table, columns);
  while (!whole && table.rows.size() > 1 && std::count(text.begin(), text.end(), '\n') > kScoreLines) {
    table.rows.pop_back();
    text = to_text(table, columns);
  }
  const std::size_t left_out = rows - table.rows.size();
  fmt::print("{}{}\n", text, left_out > 0 ? fmt::format("{} more: --verbose, or the report", left_out) : "");
  print_answer(answer_of(document));
}

namespace {

constexpr std::int64_t kSilentNs = 1'000'000'000;  // shorter work needs no bar
constexpr std::int64_t kRedrawNs = 100'000'000;    // ten times a second
constexpr std::int64_t kLogNs = 5'000'000'000;     // a line of a log stands for so long
constexpr double kBelievableFraction = 0.02;       // before that a time left would only jump about
constexpr int kBarCells = 24;

std::string seconds(double s) {
  constexpr int kMinute = 60;
  const int whole = static_cast<int>(s + 0.5);
  return whole < kMinute ? fmt::format("{} s", whole)
                         : fmt::format("{} min {:02} s", whole / kMinute, whole % kMinute);
}

}  // namespace

ProgressBar::ProgressBar() : terminal_(::isatty(STDERR_FILENO) == 1) {}

ProgressBar::~ProgressBar() {
  clear();
}

void ProgressBar::clear() {
  if (drawn_) std::fputs("\r\033[K", stderr);
  drawn_ = false;
}

void ProgressBar::report(std::string_view what, double fraction) {
  const std::int64_t now = monotonic_ns();
  if (!terminal_) {
    // A log gets a plain line now and then, so that a long job is not taken for a dead one.
    if (prefix_.empty() || now - last_draw_ns_ < kLogNs || phase_ == what) return;
    last_draw_ns_ = now;
    phase_ = what;
    tell("{}{}\n", prefix_, phase_);
    return;
  }
  if (phase_ != what) {
    phase_ = what;
    // A phase whose text changes with every report ("12.3 MB") goes on from where it began.
    if (fraction >= 0.0 || phase_start_ns_ == 0) phase_start_ns_ = now;
  }
  if (now - phase_start_ns_ < kSilentNs || now - last_draw_ns_ < kRedrawNs) return;
  last_draw_ns_ = now;
  const double elapsed_s = static_cast<double>(now - phase_start_ns_) * 1e-9;
  std::string line = prefix_ + phase_;
  if (fraction >= 0.0) {
    const double f = std::clamp(fraction, 0.0, 1.0);
    const auto filled = static_cast<std::size_t>(f * kBarCells);
    line += fmt::format("  [{}{}] {:3.0f} %", std::string(filled, '#'), std::string(kBarCells - filled, '.'),
                        100.0 * f);
    if (f > kBelievableFraction) line += fmt::format("  {} left", seconds(elapsed_s * (1.0 - f) / f));
  } else {
    line += fmt::format("  {}", seconds(elapsed_s));
  }
  tell("\r\033[K{}", line.substr(0, terminal_columns(STDERR_FILENO) - 1));
  std::fflush(stderr);
  drawn_ = true;
}

}  // namespace palpate::experiments
