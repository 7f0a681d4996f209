// Number formats for terminal, report, figures and plan: three significant digits, separated thousands,
// powers of ten for extremes, a dash for no number. UTF-8.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace palpate {

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
