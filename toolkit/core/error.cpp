#include <palpate/result.h>

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

}  // namespace palpate
