#include <palpate/result.h>

#include <fmt/format.h>

namespace palpate {

std::string Error::message() const {
  std::string text;
  if (!file.empty()) {
    text += file;
    if (line > 0) text.append(":").append(std::to_string(line));
    text += ": ";
  }
  text += what;
  if (!remedy.empty()) text.append("; ").append(remedy);
  return text;
}

Error Error::in_file(std::string path, std::int64_t at_line) && {
  // A line belongs to its file: an error about another file keeps that one, without a line.
  if (!file.empty() && file != path) return std::move(*this);
  file = std::move(path);
  if (line == 0) line = at_line;
  return std::move(*this);
}

Error over_memory_limit(std::string_view what, std::uint64_t limit_bytes) {
  return Error{fmt::format("{} would take more than the {} bytes of memory allowed", what, limit_bytes),
               fmt::format("if the file is meant to be this large, give more than --memory-limit-gb {:.3g}; "
                           "else check it, its header above all",
                           static_cast<double>(limit_bytes) / kBytesPerGb)};
}

}  // namespace palpate
