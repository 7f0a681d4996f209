// Words for a person on standard error: dropped where they cannot be written, never an exception.
#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <string>
#include <utility>

namespace palpate {

/// Writes to standard error what fmt::format makes of it. A stream that is closed, full or gone loses the
/// message and nothing else: work goes on, and a device is stopped as it would be. Results are no messages:
/// what they are written by reports its failure. Any thread.
template <class... Args>
void tell(fmt::format_string<Args...> format, Args&&... args) noexcept {
  try {
    const std::string text = fmt::format(format, std::forward<Args>(args)...);
    (void)std::fwrite(text.data(), 1, text.size(), stderr);
  } catch (...) {  // NOLINT(bugprone-empty-catch): no memory left for words
  }
}

}  // namespace palpate
