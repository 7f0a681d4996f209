// Text for people: numbers, foreign words, messages on standard error. UTF-8.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <iterator>
#include <optional>
#include <ranges>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

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

// Foreign words: shown shortened, with suggestions for unknown names.

/// A token in quotes, shortened, without control characters.
[[nodiscard]] std::string shown(std::string_view token);

/// "a, b, c".
[[nodiscard]] std::string joined(const std::vector<std::string>& words, std::string_view between = ", ");

/// The names of things with a `name`.
template <std::ranges::range Things>
[[nodiscard]] std::vector<std::string> names_of(const Things& things) {
  std::vector<std::string> names;
  std::ranges::transform(things, std::back_inserter(names), [](const auto& thing) { return thing.name; });
  return names;
}

/// The known name of fewest edits, else the first that holds `wrong`; empty if over a third of it differs.
[[nodiscard]] std::string nearest_name(std::string_view wrong, const std::vector<std::string>& known);

/// "did you mean 'cloud'?", or `otherwise` if none is near.
[[nodiscard]] std::string did_you_mean(std::string_view wrong, const std::vector<std::string>& known,
                                       std::string_view otherwise);

// Numbers for terminal, report, figures and plan: three significant digits, separated thousands, powers of
// ten for extremes, a dash for no number.

/// Stands for no number: not measured, nothing to compare, or not finite.
inline constexpr const char* kMissingNumber = "–";

/// 0.0374, 2.40, 1,002,001, 6.18×10⁻⁷.
[[nodiscard]] std::string format_number(double value);
[[nodiscard]] std::string format_number(const std::optional<double>& value);
[[nodiscard]] std::string format_count(std::uint64_t value);
/// A time in a suitable unit: 42.0 µs, 0.420 ms, 25.1 s, 3.00 min.
[[nodiscard]] std::string format_duration(double ms);
/// 812 bytes, 48.1 MB, 1.25 GB.
[[nodiscard]] std::string format_bytes(double bytes);

/// `value`, or 0 if rounding alone could cause it: such a number, and a ratio to it, mean nothing.
[[nodiscard]] double zero_if_rounding(double value, double rounding) noexcept;

/// A value in multiples of `best`: "7.50 times", "more than a million times". Empty if almost equal, or
/// `best` is 0.
[[nodiscard]] std::string format_ratio(double value, double best);

/// Numbers side by side: all with the decimals that the smallest needs for three digits, within the largest's
/// limit; a dash for none, "<0.001" for non-zero values that would read as 0.
[[nodiscard]] std::vector<std::string> format_aligned(const std::vector<std::optional<double>>& values);
/// The same for times, in "µs", "ms" or "s" by the longest.
struct AlignedTimes {
  std::string unit;
  std::vector<std::string> texts;
};
[[nodiscard]] AlignedTimes format_aligned_times(const std::vector<std::optional<double>>& ms);

}  // namespace palpate
