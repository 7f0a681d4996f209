#include "toolkit/core/messages.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace palpate {
namespace {

/// Edit distance with swaps of adjacent letters (Damerau 1964, no edits inside a swap).
std::size_t edits(std::string_view a, std::string_view b) {
  std::vector<std::vector<std::size_t>> d(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i) d[i][0] = i;
  for (std::size_t j = 0; j <= b.size(); ++j) d[0][j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = d[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, replaced});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
    }
  }
  return d[a.size()][b.size()];
}

constexpr std::size_t kLongestName = 64;     // longer words are not misspelt keys
constexpr std::size_t kEditsPerLetters = 3;  // up to one wrong letter in three

constexpr int kDigits = 3;
constexpr std::size_t kGroup = 3;
constexpr double kTen = 10.0;
// Beyond these a power of ten reads better than zeros.
constexpr double kSmall = 1e-3, kLarge = 1e9;
constexpr double kUsPerMs = 1e3, kSecondMs = 1e3, kMinuteMs = 6e4;
constexpr double kLeastMs = 0.1;  // shorter times are in µs
// A lower ratio says "the same"; a higher one only that the other number is rounding or chance.
constexpr double kWorthSaying = 1.05, kMillion = 1e6;

/// Separates thousands before the decimal point.
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

/// Decimals for numbers from `low` to `high`, neither 0.
int decimals_of(double low, double high) {
  constexpr int kMaxDigits = 5;  // of the largest: more would exceed any measurement
  const int before_point = std::max(0, power_of(high) + 1);
  // A single number, or several small ones, keep three digits.
  const int needed = std::max(0, kDigits - 1 - power_of(high));
  const int wanted = std::max(0, kDigits - 1 - power_of(low));
  return std::max(0, std::min(wanted, std::max(kMaxDigits - before_point, needed)));
}

}  // namespace

std::string shown(std::string_view token) {
  constexpr std::size_t kShown = 40;  // enough to find it in an editor
  std::string text = "'";
  for (const char c : token.substr(0, kShown)) text += c >= ' ' && c < 0x7F ? c : '?';
  return text + (token.size() > kShown ? "..'" : "'");
}

std::string joined(const std::vector<std::string>& words, std::string_view between) {
  return fmt::format("{}", fmt::join(words, between));
}

std::string nearest_name(std::string_view wrong, const std::vector<std::string>& known) {
  if (wrong.size() > kLongestName) return {};
  std::string best;
  std::size_t fewest = wrong.size() / kEditsPerLetters + 1;
  for (const std::string& name : known) {
    const std::size_t distance = edits(wrong, name);
    // A part of a known name ("bunny" for "stanford-bunny") matches, whatever is missing.
    const bool part = wrong.size() > 2 && name.find(wrong) != std::string::npos;
    if (distance < fewest || (part && best.empty())) {
      best = name;
      fewest = std::min(distance, fewest);
    }
  }
  return best;
}

std::string did_you_mean(std::string_view wrong, const std::vector<std::string>& known,
                         std::string_view otherwise) {
  const std::string near = nearest_name(wrong, known);
  return near.empty() ? std::string(otherwise) : "did you mean '" + near + "'?";
}

std::string format_number(double v) {
  const double a = std::abs(v);
  if (!std::isfinite(v)) return kMissingNumber;
  if (v == 0.0) return "0";
  if (!plain(a)) return power_of_ten(v);
  return grouped(fmt::format("{:.{}f}", v, std::max(0, kDigits - 1 - power_of(a))));
}

std::string format_number(const std::optional<double>& value) {
  return value ? format_number(*value) : kMissingNumber;
}

std::string format_count(std::uint64_t value) {
  return grouped(fmt::format("{}", value));
}

std::string format_duration(double ms) {
  if (!std::isfinite(ms)) return kMissingNumber;
  if (ms >= kMinuteMs) return format_number(ms / kMinuteMs) + " min";
  if (ms >= kSecondMs) return format_number(ms / kSecondMs) + " s";
  return ms >= kLeastMs || ms == 0.0 ? format_number(ms) + " ms" : format_number(ms * kUsPerMs) + " µs";
}

std::string format_bytes(double bytes) {
  static constexpr std::array<std::pair<double, const char*>, 3> kUnits = {
      {{1e9, " GB"}, {1e6, " MB"}, {1e3, " kB"}}};
  for (const auto& [unit, name] : kUnits)
    if (bytes >= unit) return format_number(bytes / unit) + name;
  return fmt::format("{:.0f} bytes", bytes);
}

double zero_if_rounding(double value, double rounding) noexcept {
  return std::abs(value) <= rounding ? 0.0 : value;
}

std::string format_ratio(double value, double best) {
  if (!(best > 0.0) || !(value / best >= kWorthSaying)) return {};
  return value / best > kMillion ? "more than a million times" : format_number(value / best) + " times";
}

std::vector<std::string> format_aligned(const std::vector<std::optional<double>>& values) {
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
      texts.emplace_back(kMissingNumber);
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

AlignedTimes format_aligned_times(const std::vector<std::optional<double>>& ms) {
  double longest = 0.0;
  for (const auto& v : ms) longest = std::max(longest, v.value_or(0.0));
  const bool seconds = longest >= kSecondMs, microseconds = longest > 0.0 && longest < kLeastMs;
  std::vector<std::optional<double>> values = ms;
  for (auto& v : values)
    if (v) *v = seconds ? *v / kSecondMs : microseconds ? *v * kUsPerMs : *v;
  return {seconds ? "s" : microseconds ? "µs" : "ms", format_aligned(values)};
}

}  // namespace palpate
