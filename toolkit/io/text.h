// Tokens and numbers of text formats, by std::from_chars: no locale, no allocation.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "toolkit/core/csv_dialect.h"
#include "toolkit/core/messages.h"

namespace palpate::io {

[[nodiscard]] inline bool is_blank(char c) noexcept {
  return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f';
}
using palpate::trimmed;
/// The remedy where nothing better is known.
inline constexpr const char* kCheckLine = "check the file at this line";
[[nodiscard]] std::string lower_case(std::string_view text);

/// Cuts the next token between blanks off the front of `rest`; empty at the end.
[[nodiscard]] inline std::string_view next_token(std::string_view& rest) noexcept {
  std::size_t begin = 0;
  while (begin < rest.size() && is_blank(rest[begin])) ++begin;
  std::size_t end = begin;
  while (end < rest.size() && !is_blank(rest[end])) ++end;
  const std::string_view token = rest.substr(begin, end - begin);
  rest.remove_prefix(end);
  return token;
}

/// The whole token as a number: a leading +, nan and inf in any case and as old Microsoft libraries print
/// them
/// (-1.#IND) are understood; what a double cannot hold becomes infinite or 0. Empty where it is no number.
[[nodiscard]] std::optional<double> parse_real(std::string_view token) noexcept;
/// The whole token as a whole number.
[[nodiscard]] std::optional<std::int64_t> parse_whole(std::string_view token) noexcept;

/// shown(), under the name that readers know it by.
[[nodiscard]] inline std::string quoted(std::string_view token) {
  return shown(token);
}

/// Rounds to float; beyond float's range it is infinite.
[[nodiscard]] float to_float(double value) noexcept;

}  // namespace palpate::io
