#include "toolkit/io/buffered_input.h"

#include <fmt/format.h>

#include <cstring>

#include "toolkit/core/csv_dialect.h"

namespace palpate::io {

namespace {
constexpr std::size_t kFirstBuffer = std::size_t{1} << 16;
// After moving what is left to the front there is always room for the longest line to be whole.
constexpr std::size_t kMaxBuffer = 2 * kMaxLineBytes;
}  // namespace

BufferedInput::BufferedInput(ByteSource& source) : source_(source), buffer_(kFirstBuffer) {}

bool BufferedInput::refill() {
  if (ended_ || error_) return false;
  if (begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  if (end_ == buffer_.size()) {
    if (buffer_.size() >= kMaxBuffer) return false;
    buffer_.resize(2 * buffer_.size());
  }
  const Result<std::size_t> got =
      source_.read(std::as_writable_bytes(std::span(buffer_.data() + end_, buffer_.size() - end_)));
  if (!got) {
    error_ = got.error();
    return false;
  }
  ended_ = *got == 0;
  end_ += *got;
  return !ended_;
}

bool BufferedInput::next_line(std::string_view& line) {
  if (line_ == 0) {
    while (end_ < buffer_.size() && refill()) continue;
    if (ends_lines_with_cr({buffer_.data(), end_})) line_end_ = '\r';
  }
  std::size_t searched = 0;
  while (true) {
    const std::size_t have = end_ - begin_;
    const char* unsearched = buffer_.data() + begin_ + searched;
    const void* found = have > searched ? std::memchr(unsearched, line_end_, have - searched) : nullptr;
    std::size_t length = have;
    if (found != nullptr) {
      length = searched + static_cast<std::size_t>(static_cast<const char*>(found) - unsearched);
    } else {
      searched = have;
      if (have <= kMaxLineBytes && refill()) continue;
      if (error_ || (have == 0 && ended_)) return false;
    }
    ++line_;
    if (length > kMaxLineBytes) {
      error_ = Error{fmt::format("a line is longer than {} bytes", kMaxLineBytes),
                     "check that the file is what its name says",
                     {},
                     line_};
      return false;
    }
    const char* from = buffer_.data() + begin_;  // read now: refill() moves things even when it fails
    begin_ += length + (found != nullptr ? 1 : 0);
    if (length > 0 && from[length - 1] == '\r') --length;
    line = std::string_view(from, length);
    return line_ > 1 || without_mark(line);
  }
}

bool BufferedInput::without_mark(std::string_view& first_line) {
  const Result<std::size_t> mark = byte_order_mark(first_line);
  if (mark)
    first_line.remove_prefix(*mark);
  else
    error_ = mark.error();
  return mark.ok();
}

const std::byte* BufferedInput::take(std::size_t n) {
  while (end_ - begin_ < n) {
    if (!refill()) return nullptr;
  }
  if (error_) return nullptr;
  const char* at = buffer_.data() + begin_;
  begin_ += n;
  return reinterpret_cast<const std::byte*>(at);
}

std::optional<std::uint64_t> BufferedInput::remaining() const {
  const std::optional<std::uint64_t> rest = source_.remaining();
  if (!rest) return std::nullopt;
  return *rest + (end_ - begin_);
}

Error BufferedInput::error_or(Error otherwise) const {
  if (error_) return *error_;
  if (otherwise.line == 0) otherwise.line = line_;
  return otherwise;
}

}  // namespace palpate::io
