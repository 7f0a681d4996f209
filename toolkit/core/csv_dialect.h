// Separators, line ends and decimal marks of text tables; shared by clouds, probe paths and traces.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <palpate/result.h>

namespace palpate {

/// Without blanks at both ends.
[[nodiscard]] std::string_view trimmed(std::string_view text) noexcept;

/// True if lines end with a carriage return only (old Macintosh files): `head`, some kilobytes, has no other
/// line end.
[[nodiscard]] bool ends_lines_with_cr(std::string_view head) noexcept;

/// Separator and decimal mark, detected from the first row of numbers. Not thread-safe.
class CsvDialect {
 public:
  /// Tries semicolons, then commas, then blanks, unless commas can only be decimal. An Error shows both
  /// readings of an ambiguous row. O(row).
  [[nodiscard]] static Result<CsvDialect> of(std::string_view row);
  /// For a row of names, which has no decimals.
  [[nodiscard]] static CsvDialect of_header(std::string_view row) noexcept;

  /// ',', ';', or ' ' for any run of blanks.
  [[nodiscard]] char separator() const noexcept { return separator_; }
  /// Splits a row into at most fields.size() fields; between separators they may be empty or padded.
  [[nodiscard]] std::size_t split(std::string_view row, std::span<std::string_view> fields) const noexcept;
  /// The field with a decimal point; empty if its decimal mark differs from earlier fields. Valid until the
  /// next call.
  [[nodiscard]] std::optional<std::string_view> with_decimal_point(std::string_view field);

 private:
  static constexpr char kUnknown = '\0';
  char separator_ = ' ';
  char decimal_ = kUnknown;
  std::string rewritten_;
};

/// True for a header row: no field begins as a number.
[[nodiscard]] bool is_header_row(std::span<const std::string_view> fields);

/// "1 | 5 | 2 | 5 (commas between columns) or 1.5 | 2.5 (decimal commas)"; empty if unambiguous: a field is
/// no whole number, or their count is odd.
[[nodiscard]] std::string comma_readings(std::string_view row);

/// The remedy for a field that is no number.
[[nodiscard]] std::string number_remedy(std::string_view field, std::string otherwise);

}  // namespace palpate
