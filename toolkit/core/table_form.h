// How the rows of a text table are written: what separates columns, where lines end, which mark stands before
// decimals. One place for clouds, probe paths and traces.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "toolkit/core/result.h"

namespace palpate {

/// Without the blanks at both ends.
[[nodiscard]] std::string_view trimmed(std::string_view text) noexcept;

/// Whether a carriage return alone ends the lines of a text that begins with `head` (old Macintosh files): a
/// head of some kilobytes has no other line end.
[[nodiscard]] bool ends_lines_with_cr(std::string_view head) noexcept;

/// Separator and decimal mark, told from the first row of numbers and kept for the table. Not thread-safe.
class TableForm {
 public:
  /// Semicolons separate before commas, commas before blanks, unless the commas can only be decimal commas.
  /// An Error that shows both readings where a row of commas can be read in two ways. O(row).
  [[nodiscard]] static Result<TableForm> of(std::string_view row);
  /// The same for a row of names, which has no decimals.
  [[nodiscard]] static TableForm of_names(std::string_view row) noexcept;

  /// ',', ';', or ' ' for any run of blanks.
  [[nodiscard]] char separator() const noexcept { return separator_; }
  /// Cuts a row into at most fields.size() fields; between marks they may be empty or stand between blanks.
  [[nodiscard]] std::size_t split(std::string_view row, std::span<std::string_view> fields) const noexcept;
  /// The field as a number with a decimal point; empty where it has another decimal mark than the fields
  /// before. The view lives until the next call.
  [[nodiscard]] std::optional<std::string_view> with_point(std::string_view field);

 private:
  static constexpr char kUnknown = '\0';
  char separator_ = ' ';
  char decimal_ = kUnknown;
  std::string rewritten_;
};

/// Whether the fields are a line of names, as tables have it above their columns: none begins as a number.
[[nodiscard]] bool names_columns(std::span<const std::string_view> fields);

/// "1 | 5 | 2 | 5 (commas between columns) or 1.5 | 2.5 (decimal commas)"; empty where a row of commas has
/// only one reading: some field is no whole number, or their count is odd.
[[nodiscard]] std::string both_comma_readings(std::string_view row);

/// What to do about a field that is no number.
[[nodiscard]] std::string number_remedy(std::string_view field, std::string otherwise);

}  // namespace palpate
