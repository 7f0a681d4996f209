#include "toolkit/core/numbers.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace palpate {
namespace {

constexpr int kDigits = 3;
constexpr std::size_t kGroup = 3;
constexpr double kTen = 10.0;
// Below and from here on a power of ten is easier to read than zeros.
constexpr double kSmall = 1e-3, kLarge = 1e9;
constexpr double kUsPerMs = 1e3, kSecondMs = 1e3, kMinuteMs = 6e4;
constexpr double kLeastMs = 0.1;  // shorter times are in µs
// A ratio below the first says "the same"; one above the second says no more than that the other one is
// rounding or chance.
constexpr double kWorthSaying = 1.05, kMillion = 1e6;

/// Thousands separated before the decimal point.
std::string grouped(std::string digits) {
  const std::size_t first = digits.empty() || digits.front() != '-' ? 0 : 1;
  const std::size_t point = std::min(digits.find('.'), digits.size());
  for (std::size_t at = point; at > first + kGroup; at -= kGroup) digits.insert(at - kGroup, ",");
  return digits;
}

/// 6.18×10⁻⁷.
std::string power_of_ten(double v) {
  static constexpr std::array<const char*, 10> kRaised = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  const std::string text = fmt::format("{:.{}e}", v, kDigits - 1);  // 6.18e-07: rounding may raise the power
  const std::size_t e = text.find('e');
  const int power = std::stoi(text.substr(e + 1));
  std::string raised = power < 0 ? "⁻" : "";
  for (const char digit : std::to_string(std::abs(power)))
    raised += kRaised[static_cast<std::size_t>(digit - '0')];
  return text.substr(0, e) + "×10" + raised;
}

bool plain(double magnitude) {
  return magnitude == 0.0 || (magnitude >= kSmall && magnitude < kLarge);
}

int power_of(double magnitude) {
  return static_cast<int>(std::floor(std::log10(magnitude)));
}

/// How many decimals suit numbers from `low` to `high`, neither 0.
int decimals_of(double low, double high) {
  constexpr int kMostDigits = 5;  // of the largest: more would claim what no measurement holds
  const int before_point = std::max(0, power_of(high) + 1);
  // A single number, or several small ones, keep their three digits.
  const int needed = std::max(0, kDigits - 1 - power_of(high));
  const int wanted = std::max(0, kDigits - 1 - power_of(low));
  return std::max(0, std::min(wanted, std::max(kMostDigits - before_point, needed)));
}

}  // namespace

std::string short_number(double v) {
  const double a = std::abs(v);
  if (!std::isfinite(v)) return kNoNumber;
  if (v == 0.0) return "0";
  if (!plain(a)) return power_of_ten(v);
  return grouped(fmt::format("{:.{}f}", v, std::max(0, kDigits - 1 - power_of(a))));
}

std::string short_number(const std::optional<double>& value) {
  return value ? short_number(*value) : kNoNumber;
}

std::string count_text(std::uint64_t value) {
  return grouped(fmt::format("{}", value));
}

std::string duration_text(double ms) {
  if (!std::isfinite(ms)) return kNoNumber;
  if (ms >= kMinuteMs) return short_number(ms / kMinuteMs) + " min";
  if (ms >= kSecondMs) return short_number(ms / kSecondMs) + " s";
  return ms >= kLeastMs || ms == 0.0 ? short_number(ms) + " ms" : short_number(ms * kUsPerMs) + " µs";
}

std::string bytes_text(double bytes) {
  static constexpr std::array<std::pair<double, const char*>, 3> kUnits = {
      {{1e9, " GB"}, {1e6, " MB"}, {1e3, " kB"}}};
  for (const auto& [unit, name] : kUnits)
    if (bytes >= unit) return short_number(bytes / unit) + name;
  return fmt::format("{:.0f} bytes", bytes);
}

double settled(double value, double rounding) noexcept {
  return std::abs(value) <= rounding ? 0.0 : value;
}

std::string ratio_text(double value, double best) {
  if (!(best > 0.0) || !(value / best >= kWorthSaying)) return {};
  return value / best > kMillion ? "more than a million times" : short_number(value / best) + " times";
}

std::vector<std::string> aligned_numbers(const std::vector<std::optional<double>>& values) {
  double low = 0.0, high = 0.0;
  for (const auto& v : values) {
    if (!v || *v == 0.0 || !std::isfinite(*v) || std::abs(*v) >= kLarge) continue;
    const double a = std::abs(*v);
    low = low == 0.0 ? a : std::min(low, a);
    high = std::max(high, a);
  }
  const bool all_small = high < kSmall;
  const int decimals = all_small ? 0 : decimals_of(low, high);
  const double least = std::pow(kTen, -decimals);
  std::vector<std::string> texts;
  for (const auto& v : values) {
    if (!v || !std::isfinite(*v))
      texts.emplace_back(kNoNumber);
    else if (*v == 0.0)
      texts.emplace_back("0");
    else if (all_small || std::abs(*v) >= kLarge)
      texts.push_back(power_of_ten(*v));
    else if (std::abs(*v) < 0.5 * least)
      texts.push_back(fmt::format("{}{:.{}f}", *v < 0.0 ? ">-" : "<", least, decimals));
    else
      texts.push_back(grouped(fmt::format("{:.{}f}", *v, decimals)));
  }
  return texts;
}

AlignedTimes aligned_times(const std::vector<std::optional<double>>& ms) {
  double longest = 0.0;
  for (const auto& v : ms) longest = std::max(longest, v.value_or(0.0));
  const bool seconds = longest >= kSecondMs, microseconds = longest > 0.0 && longest < kLeastMs;
  std::vector<std::optional<double>> values = ms;
  for (auto& v : values)
    if (v) *v = seconds ? *v / kSecondMs : microseconds ? *v * kUsPerMs : *v;
  return {seconds ? "s" : microseconds ? "µs" : "ms", aligned_numbers(values)};
}

}  // namespace palpate
