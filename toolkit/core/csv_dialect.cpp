#include "toolkit/core/csv_dialect.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include <palpate/options.h>

namespace palpate {
namespace {

constexpr std::string_view kBlanks = " \t\r\v\f";
constexpr std::string_view kTextDigits = "0123456789";
// x, y and z with a decimal each.
constexpr std::size_t kMinDecimalPairs = 3;

bool is_digit(char c) noexcept {
  return kTextDigits.find(c) != std::string_view::npos;
}

// Digits with optional sign.
bool is_whole(std::string_view field) noexcept {
  if (!field.empty() && (field.front() == '-' || field.front() == '+')) field.remove_prefix(1);
  return !field.empty() && field.find_first_not_of(kTextDigits) == std::string_view::npos;
}

// At most one comma, followed by a digit, and otherwise only characters of a number.
bool may_have_decimal_comma(std::string_view field) noexcept {
  const std::size_t comma = field.find(',');
  return comma == std::string_view::npos ||
         (comma + 1 < field.size() && is_digit(field[comma + 1]) &&
          field.find(',', comma + 1) == std::string_view::npos && field.find('.') == std::string_view::npos);
}

std::vector<std::string_view> fields_between(std::string_view row, char separator) {
  std::vector<std::string_view> fields;
  while (true) {
    const std::size_t at = row.find(separator);
    fields.push_back(trimmed(row.substr(0, at)));
    if (at == std::string_view::npos) return fields;
    row.remove_prefix(at + 1);
  }
}

std::vector<std::string_view> blank_tokens(std::string_view row) {
  std::vector<std::string_view> tokens;
  for (row = trimmed(row); !row.empty();) {
    const std::size_t end = std::min(row.find_first_of(kBlanks), row.size());
    tokens.push_back(row.substr(0, end));
    row = trimmed(row.substr(end));
  }
  return tokens;
}

}  // namespace

std::string_view trimmed(std::string_view text) noexcept {
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
}

bool ends_lines_with_cr(std::string_view head) noexcept {
  return head.find('\n') == std::string_view::npos && head.find('\r') != std::string_view::npos;
}

Result<CsvDialect> CsvDialect::of(std::string_view row) {
  CsvDialect form = of_header(row);
  const bool point = row.find('.') != std::string_view::npos;
  if (form.separator_ == ',') {
    const std::vector<std::string_view> tokens = blank_tokens(row), fields = fields_between(row, ',');
    const bool blanks_inside = std::any_of(fields.begin(), fields.end(), [](std::string_view field) {
      return field.find_first_of(kBlanks) != std::string_view::npos;
    });
    if (blanks_inside && std::all_of(tokens.begin(), tokens.end(), may_have_decimal_comma)) {
      form.separator_ = ' ';
      form.decimal_ = ',';
      return form;
    }
    // Whole numbers are not written as 001; decimals after a comma are.
    bool decimals = fields.size() >= 2 * kMinDecimalPairs;
    for (std::size_t i = 1; decimals && i < fields.size(); i += 2)
      if (fields[i].size() > 1 && fields[i].front() == '0') {
        const std::string readings = comma_readings(row);
        if (readings.empty()) break;
        return Error{"commas stand between columns or before decimals: " + readings,
                     "separate columns by semicolons, or write decimal points"};
      }
    form.decimal_ = '.';
  } else if (row.find(',') != std::string_view::npos) {
    form.decimal_ = ',';
  } else if (point) {
    form.decimal_ = '.';
  }
  return form;
}

CsvDialect CsvDialect::of_header(std::string_view row) noexcept {
  CsvDialect form;
  for (const char mark : {';', ','})
    if (row.find(mark) != std::string_view::npos) {
      form.separator_ = mark;
      break;
    }
  return form;
}

std::size_t CsvDialect::split(std::string_view row, std::span<std::string_view> fields) const noexcept {
  std::size_t count = 0;
  const bool blank = separator_ == ' ';
  if (blank) row = trimmed(row);
  while (count < fields.size() && !(blank && row.empty())) {
    const std::size_t at = blank ? row.find_first_of(kBlanks) : row.find(separator_);
    fields[count++] = row.substr(0, at);
    if (at == std::string_view::npos) break;
    row.remove_prefix(at + 1);
    if (blank) row.remove_prefix(std::min(row.find_first_not_of(kBlanks), row.size()));
  }
  return count;
}

std::optional<std::string_view> CsvDialect::with_decimal_point(std::string_view field) {
  if (decimal_ == '.') return field;
  const std::size_t mark = field.find_first_of(".,");
  if (mark == std::string_view::npos) return field;
  if (decimal_ == kUnknown) decimal_ = field[mark];
  if (decimal_ == '.') return field;
  if (field[mark] == '.' || !may_have_decimal_comma(field)) return std::nullopt;
  rewritten_ = field;
  rewritten_[mark] = '.';
  return rewritten_;
}

bool is_header_row(std::span<const std::string_view> fields) {
  static constexpr std::string_view kNumberStarts = "+-.,0123456789";
  return std::none_of(fields.begin(), fields.end(), [](std::string_view field) {
    field = trimmed(field);
    return !field.empty() &&
           (kNumberStarts.find(field.front()) != std::string_view::npos || parse_number(field).ok());
  });
}

std::string comma_readings(std::string_view row) {
  const std::vector<std::string_view> fields = fields_between(row, ',');
  if (fields.size() % 2 != 0 || !std::all_of(fields.begin(), fields.end(), is_whole)) return {};
  std::string columns, decimals;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    columns += fmt::format("{}{}", i == 0 ? "" : " | ", fields[i]);
    decimals += fmt::format("{}{}", i == 0 ? "" : i % 2 == 1 ? "." : " | ", fields[i]);
  }
  return fmt::format("{} (commas between columns) or {} (decimal commas)", columns, decimals);
}

std::string number_remedy(std::string_view field, std::string otherwise) {
  return field.find(',') == std::string_view::npos ? std::move(otherwise)
                                                   : "write decimal points, not decimal commas";
}

}  // namespace palpate
