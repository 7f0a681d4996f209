// A buffered view of a ByteSource: lines of text and blocks of bytes from the same stream. Used by the
// readers only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/io/byte_source.h"

namespace palpate::io {

/// No row of numbers and no header line is longer; an endless line is refused instead of stored.
inline constexpr std::size_t kMaxLineBytes = std::size_t{1} << 20;

class BufferedInput {
 public:
  explicit BufferedInput(ByteSource& source);

  /// The next line without its end (\n, \r\n, or \r in a file that begins so; the last may lack it), the
  /// first without a byte order mark. False at the end of the data, and after an error (see error()). The
  /// view lives until the next call of any member.
  [[nodiscard]] bool next_line(std::string_view& line);
  /// The next n bytes, n <= kMaxLineBytes, or null where the data ends before or an error stands.
  [[nodiscard]] const std::byte* take(std::size_t n);
  /// The line next_line() gave last, counted from 1.
  [[nodiscard]] std::int64_t line_number() const noexcept { return line_; }
  /// Bytes left to give, where the source knows.
  [[nodiscard]] std::optional<std::uint64_t> remaining() const;
  [[nodiscard]] double fraction() const { return source_.fraction(); }
  /// The source's error or that of an endless line; empty while all is well.
  [[nodiscard]] const std::optional<Error>& error() const noexcept { return error_; }
  /// error() if there is one, else `otherwise` with the present line.
  [[nodiscard]] Error error_or(Error otherwise) const;

 private:
  bool refill();
  bool without_mark(std::string_view& first_line);

  ByteSource& source_;
  std::vector<char> buffer_;
  std::size_t begin_ = 0;
  std::size_t end_ = 0;
  std::int64_t line_ = 0;
  char line_end_ = '\n';
  bool ended_ = false;
  std::optional<Error> error_;
};

}  // namespace palpate::io
