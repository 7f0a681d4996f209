// The terminal that somebody looks at, and what is printed there.
#pragma once

#include <cstddef>
#include <vector>

#include "experiments/report/tables.h"

namespace palpate::experiments {

/// Columns of the terminal behind a file descriptor: what the environment's COLUMNS says, else what the
/// terminal itself does, else 80 (a pipe, a file).
[[nodiscard]] std::size_t terminal_columns(int descriptor);

/// Prints all tables, or of the first one what fits `kBriefLines` and how many lines more there are.
inline constexpr std::size_t kBriefLines = 10;
void print_tables(const std::vector<Table>& tables, bool whole);
/// Prints the scores of a study: all, or a line a renderer and the finding that the report begins with.
void print_scores(const metrics::ResultDocument& document, bool whole);

}  // namespace palpate::experiments
