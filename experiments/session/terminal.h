// The terminal that somebody looks at: how wide it is, a progress bar with the time left, and what is
// printed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <palpate/progress.h>
#include "experiments/report/findings.h"
#include "experiments/report/tables.h"

namespace palpate::experiments {

/// Columns of the terminal behind a file descriptor: what the environment's COLUMNS says, else what the
/// terminal itself does, else 80 (a pipe, a file).
[[nodiscard]] std::size_t terminal_columns(int descriptor);

/// Prints all tables, or of the first one what fits `kBriefLines` and how many lines more there are.
inline constexpr std::size_t kBriefLines = 10;
void print_tables(const std::vector<Table>& tables, bool whole);
/// Tells each line on standard error: all, or three lines at most, of which the last says how many there are
/// more.
void tell_lines(const std::vector<std::string>& lines, bool all);
/// Prints what a page answers first, wrapped.
void print_answer(const Headline& answer);
/// Prints the scores of a study: all, or a line a renderer and the finding that the report begins with.
void print_scores(const metrics::ResultDocument& document, bool whole);

/// Draws on standard error from the second second of a phase on; on anything but a terminal a job of
/// several steps (set_prefix) prints a line every few seconds, and any other nothing.
class ProgressBar final : public Progress {
 public:
  ProgressBar();
  ~ProgressBar() override;
  void report(std::string_view what, double fraction) override;

  /// Removes what is drawn, before other text is printed.
  void clear();
  /// Put before every phase, "[2/5] sinusoid: ".
  void set_prefix(std::string prefix) { prefix_ = std::move(prefix); }

 private:
  bool terminal_ = false;
  bool drawn_ = false;
  std::string prefix_;
  std::string phase_;
  std::int64_t phase_start_ns_ = 0;
  std::int64_t last_draw_ns_ = 0;
};

}  // namespace palpate::experiments
