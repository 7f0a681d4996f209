// The terminal that somebody looks at.
#pragma once

#include <cstddef>

namespace palpate::experiments {

/// Columns of the terminal behind a file descriptor: what the environment's COLUMNS says, else what the
/// terminal itself does, else 80 (a pipe, a file).
[[nodiscard]] std::size_t terminal_columns(int descriptor);

}  // namespace palpate::experiments
