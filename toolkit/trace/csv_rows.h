// Rows of text, with line numbers in messages. They are checked, and read through a fixed buffer. Internal to
// traces and scores.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include <palpate/result.h>
#include <palpate/trace.h>
#include "toolkit/core/csv_dialect.h"
#include "toolkit/core/files.h"

namespace palpate::trace {

/// Reads a text file line by line in a fixed buffer.
class LineReader {
 public:
  [[nodiscard]] static Result<LineReader> open(const std::string& file, std::uint64_t max_bytes);
  /// Reads the next non-blank line, without its end and without a byte order mark; false at the end of the
  /// file or on a failure().
  bool next(std::string_view& line);
  [[nodiscard]] Error error(std::string what, std::string remedy) const;
  [[nodiscard]] const Error* failure() const { return failure_.what.empty() ? nullptr : &failure_; }
  [[nodiscard]] std::int64_t line() const { return line_; }
  /// Checks that `path` may take one more row.
  [[nodiscard]] Status fits(const ProbePath& path, std::size_t bytes_a_row) const;

 private:
  LineReader(InputFile file, std::uint64_t max_bytes);
  bool next_any(std::string_view& line);
  [[nodiscard]] std::size_t end_of_line() const { return rest_.find(line_end_); }
  void refill();
  bool is_plain(std::string_view first_line);
  bool without_mark(std::string_view& first_line);

  // Longest line: twenty numbers need some 500 characters; the rest is for comments of .traj files.
  static constexpr std::size_t kLongestLine = 4096;
  // A line without an end within it is too long.
  static constexpr std::size_t kBufferBytes = 16 * kLongestLine;
  InputFile file_;
  std::uint64_t max_bytes_;
  std::unique_ptr<std::array<char, kBufferBytes>> buffer_;
  std::string_view rest_;  ///< read, not yet returned
  bool ended_ = false;     ///< nothing follows the rest
  std::int64_t line_ = 0;
  char line_end_ = '\n';
  Error failure_{};
};

/// The dialect of a table's first row; its Error has the line.
[[nodiscard]] Result<CsvDialect> form_of(const LineReader& reader, std::string_view row);

/// A field as a finite number; the Error calls it `place`.
[[nodiscard]] Result<double> finite_number(const LineReader& reader, CsvDialect& form, std::string_view text,
                                           std::string_view place, std::string_view remedy);

/// Checks that time increases.
[[nodiscard]] Status check_time(const LineReader& reader, const ProbePath& path, double t_s);

/// Reads the header, which must be `header`, and passes every row to `row`; no row is an Error. `or_else`:
/// the Error's hint to another reader. As many fields as the header; rows may use semicolons and then decimal
/// commas.
[[nodiscard]] Status read_rows(LineReader& reader, std::string_view header, std::string_view or_else,
                               const std::function<Status(std::span<const double>)>& row);

}  // namespace palpate::trace
