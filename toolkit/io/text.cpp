#include "toolkit/io/text.h"

#include <charconv>
#include <cmath>
#include <limits>

namespace palpate::io {

std::string lower_case(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return lower;
}

namespace {

// from_chars leaves the value alone where it does not fit; what the text says decides between 0 and infinity.
double out_of_range(std::string_view token) noexcept {
  const bool negative = token.front() == '-';
  const std::size_t exponent = token.find_first_of("eE");
  bool tiny = false;
  if (exponent != std::string_view::npos) {
    tiny = exponent + 1 < token.size() && token[exponent + 1] == '-';
  } else {
    // Without an exponent: more than 308 digits before the point, or that many zeros after it.
    const std::string_view digits = token.substr(negative ? 1 : 0);
    tiny = digits.substr(0, digits.find('.')).find_first_of("123456789") == std::string_view::npos;
  }
  const double size = tiny ? 0.0 : std::numeric_limits<double>::infinity();
  return negative ? -size : size;
}

}  // namespace

std::optional<double> parse_real(std::string_view token) noexcept {
  if (token.size() > 1 && token.front() == '+' && token[1] != '-') token.remove_prefix(1);
  if (token.empty()) return std::nullopt;
  double value = 0;
  const char* const last = token.data() + token.size();
  const auto [end, code] = std::from_chars(token.data(), last, value);
  if (code == std::errc::result_out_of_range && end == last) return out_of_range(token);
  if (code != std::errc{}) return std::nullopt;
  if (end == last) return value;
  // "1.#QNAN", "-1.#IND", "1.#INF": from_chars stops at the '#'.
  if (*end == '#' && *(end - 1) == '.') {
    const std::string_view rest(end + 1, static_cast<std::size_t>(last - end) - 1);
    if (rest.starts_with("INF")) return std::copysign(std::numeric_limits<double>::infinity(), value);
    if (rest.starts_with("IND") || rest.starts_with("QNAN") || rest.starts_with("SNAN"))
      return std::numeric_limits<double>::quiet_NaN();
  }
  return std::nullopt;
}

std::optional<std::int64_t> parse_whole(std::string_view token) noexcept {
  if (token.size() > 1 && token.front() == '+' && token[1] != '-') token.remove_prefix(1);
  std::int64_t value = 0;
  const char* const last = token.data() + token.size();
  const auto [end, code] = std::from_chars(token.data(), last, value);
  if (code != std::errc{} || end != last) return std::nullopt;
  return value;
}

float to_float(double value) noexcept {
  constexpr double kMost = static_cast<double>(std::numeric_limits<float>::max());
  if (value > kMost) return std::numeric_limits<float>::infinity();
  if (value < -kMost) return -std::numeric_limits<float>::infinity();
  return static_cast<float>(value);
}

}  // namespace palpate::io
