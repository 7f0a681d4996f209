// Messages on standard error: dropped if they cannot be written, never an exception.
#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <string>
#include <utility>

namespace palpate {

/// Formats and writes to standard error. A closed, full or lost stream loses the message only, so a device is
/// still stopped. For messages, not results, whose writers report failures. Thread-safe.
template <class... Args>
void tell(fmt::format_string<Args...> format, Args&&... args) noexcept {
  try {
    const std::string text = fmt::format(format, std::forward<Args>(args)...);
    (void)std::fwrite(text.data(), 1, text.size(), stderr);
  } catch (...) {  // NOLINT(bugprone-empty-catch): no memory left for words
  }
}

}  // namespace palpate
