// Text files of rows: read line by line in a fixed buffer, checked, with the line in every message. Private
// to the readers of traces and scores.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "toolkit/core/input_file.h"
#include "toolkit/core/result.h"
#include "toolkit/core/table_form.h"
#include "toolkit/trace/trace.h"

namespace palpate::trace {

/// Reads a text file line by line in a fixed buffer.
class LineReader {
 public:
  [[nodiscard]] static Result<LineReader> open(const std::string& file, std::uint64_t max_bytes);
  /// The next line that is not blank, without its end, the first without a byte order mark; or false at the
  /// end of the file, or where there is a failure().
  bool next(std::string_view& line);
  [[nodiscard]] Error error(std::string what, std::string remedy) const;
  [[nodiscard]] const Error* failure() const { return failure_.what.empty() ? nullptr : &failure_; }
  [[nodiscard]] std::int64_t line() const { return line_; }
  /// Whether `path` may take in one more row.
  [[nodiscard]] Status fits(const ProbePath& path, std::size_t bytes_a_row) const;

 private:
  LineReader(InputFile file, std::uint64_t max_bytes);
  bool next_any(std::string_view& line);
  [[nodiscard]] std::size_t end_of_line() const { return rest_.find(line_end_); }
  void refill();
  bool is_plain(std::string_view first_line);
  bool without_mark(std::string_view& first_line);

  // Longest line read: twenty numbers need at most some 500 characters; the rest is room for comments of
  // .traj files.
  static constexpr std::size_t kLongestLine = 4096;
  // A line that has no end within it is too long.
  static constexpr std::size_t kBufferBytes = 16 * kLongestLine;
  InputFile file_;
  std::uint64_t max_bytes_;
  std::unique_ptr<std::array<char, kBufferBytes>> buffer_;
  std::string_view rest_;  ///< of the buffer: read, and not given yet
  bool ended_ = false;     ///< nothing follows the rest
  std::int64_t line_ = 0;
  char line_end_ = '\n';
  Error failure_{};
};

/// The form of a table's first row, with the line in its Error.
[[nodiscard]] Result<TableForm> form_of(const LineReader& reader, std::string_view row);

/// A field as a finite number; the Error calls it `place`.
[[nodiscard]] Result<double> finite_number(const LineReader& reader, TableForm& form, std::string_view text,
                                           std::string_view place, std::string_view remedy);

/// Time goes on.
[[nodiscard]] Status check_time(const LineReader& reader, const ProbePath& path, double t_s);

/// Reads the header, which must be `header`, then hands every row to `row`; no row is an Error. `or_else`:
/// what a reader with another header may do. As many fields as the header names; it and the rows may be
/// written with semicolons, and then with decimal commas.
[[nodiscard]] Status read_rows(LineReader& reader, std::string_view header, std::string_view or_else,
                               const std::function<Status(std::span<const double>)>& row);

}  // namespace palpate::trace
