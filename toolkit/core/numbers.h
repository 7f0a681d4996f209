// How numbers are written for people: one way for the terminal, the report, its figures and the plan. Three
// significant digits, thousands separated, powers of ten for what is very small or very large, a dash for
// nothing. All UTF-8.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace palpate {

/// What stands where there is no number: nothing measured, nothing to compare with, or not finite.
inline constexpr const char* kNoNumber = "–";

/// 0.0374, 2.40, 1,002,001, 6.18×10⁻⁷.
[[nodiscard]] std::string short_number(double value);
[[nodiscard]] std::string short_number(const std::optional<double>& value);
[[nodiscard]] std::string count_text(std::uint64_t value);
/// A time at a readable size: 42.0 µs, 0.420 ms, 25.1 s, 3.00 min.
[[nodiscard]] std::string duration_text(double ms);
/// 812 bytes, 48.1 MB, 1.25 GB.
[[nodiscard]] std::string bytes_text(double bytes);

/// `value`, or 0 where it is no more than what rounding alone makes: such a number means nothing, and a ratio
/// to it even less.
[[nodiscard]] double settled(double value, double rounding) noexcept;

/// How many times `best` a value is: "7.50 times", "more than a million times". Empty where that says
/// nothing: almost the same, or `best` is 0.
[[nodiscard]] std::string ratio_text(double value, double best);

/// Numbers that stand side by side: all with as many decimals as the smallest needs for three digits, or as
/// the largest bears; a dash for nothing, "<0.001" for what would read as nothing and is not.
[[nodiscard]] std::vector<std::string> aligned_numbers(const std::vector<std::optional<double>>& values);
/// The same for times: "µs", "ms" or "s", whichever suits the longest, and the numbers in it.
struct AlignedTimes {
  std::string unit;
  std::vector<std::string> texts;
};
[[nodiscard]] AlignedTimes aligned_times(const std::vector<std::optional<double>>& ms);

}  // namespace palpate
