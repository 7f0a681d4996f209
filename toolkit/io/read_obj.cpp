// OBJ (Wavefront Technologies, Advanced Visualizer manual, appendix B1): v and f; all else is passed over.
#include <fmt/format.h>

#include "toolkit/io/decoding.h"

namespace palpate::io {
namespace {

// The lines of a file, one that ends with a backslash joined to the next. Each lives until the next call.
class Lines {
 public:
  explicit Lines(BufferedInput& in) : in_(in) {}
  // False at the end of the data, and after an error (see error()).
  [[nodiscard]] bool next(std::string_view& line) {
    if (!in_.next_line(line)) return false;
    number_ = in_.line_number();
    if (!continues(line)) return true;
    joined_.clear();
    do {
      line.remove_suffix(1);
      joined_.append(line).push_back(' ');
      if (joined_.size() > kMaxLineBytes) {
        too_long_ = Error{fmt::format("a line and its continuations are longer than {} bytes", kMaxLineBytes),
                          "check that the file is what its name says",
                          {},
                          number_};
        return false;
      }
      if (!in_.next_line(line)) {
        line = {};
        break;
      }
    } while (continues(line));
    line = joined_.append(line);
    return true;
  }
  // Of the line given last, its first where several were joined; from 1.
  [[nodiscard]] std::int64_t number() const noexcept { return number_; }
  [[nodiscard]] const std::optional<Error>& error() const noexcept {
    return too_long_ ? too_long_ : in_.error();
  }

 private:
  // A comment ends with its line: one may name a folder.
  static bool continues(std::string_view line) noexcept {
    if (!line.ends_with('\\')) return false;
    bool after_blank = true;
    for (const char c : line) {
      if (c == '#' && after_blank) return false;
      after_blank = is_blank(c);
    }
    return true;
  }

  BufferedInput& in_;
  std::string joined_;
  std::int64_t number_ = 0;
  std::optional<Error> too_long_;
};

Error bad_line(const Lines& lines, std::string what, std::string remedy = kCheckLine) {
  return Error{std::move(what), std::move(remedy), {}, lines.number()};
}

Status read_vertex(const Lines& lines, std::string_view rest, DecodedFile& decoded) {
  const Result<Vec3> point = next_vertex(rest);
  if (!point) return bad_line(lines, point.error().what, point.error().remedy);
  decoded.points.push_back(*point);  // a weight or a colour may follow
  return Done{};
}

// "7", "7/2", "7/2/3" or "7//3": the first is the vertex, from 1; negative ones count back from the latest
// vertex.
Status read_face(const Lines& lines, std::string_view rest, FaceBuilder& faces, std::size_t points) {
  faces.begin();
  for (std::string_view token = next_token(rest); !token.empty(); token = next_token(rest)) {
    if (token.front() == '#') break;
    const std::optional<std::int64_t> number = parse_whole(token.substr(0, token.find('/')));
    if (!number) return bad_line(lines, fmt::format("the corner {} of a face is not an index", shown(token)));
    // 0 is no index in OBJ; FaceBuilder drops the face for it.
    const std::int64_t index = *number > 0   ? *number - 1
                               : *number < 0 ? static_cast<std::int64_t>(points) + *number
                                             : -1;
    if (!faces.corner(index)) return faces.too_many();
  }
  faces.end();
  return Done{};
}

}  // namespace

Result<DecodedFile> read_obj(const ReaderInput& input) {
  BufferedInput in(input.bytes);
  Lines lines(in);
  DecodedFile decoded;
  decoded.format = "OBJ";
  ReadMonitor watch(input, in, decoded);
  FaceBuilder faces(decoded, kMaxPoints, input.options);  // a face may stand before its vertices
  std::string_view line;
  while (lines.next(line)) {
    std::string_view rest = line;
    const std::string_view key = next_token(rest);
    Status read = Done{};
    if (key == "v") {
      read = read_vertex(lines, rest, decoded);
    } else if (key == "f" || key == "fo") {
      read = read_face(lines, rest, faces, decoded.points.size());
    }
    if (!read) return std::move(read).error();
    if (!watch.row()) return watch.error();
  }
  if (lines.error()) return *lines.error();
  if (decoded.points.empty())
    return Error{"the OBJ file has no vertices (no line starts with 'v')", "check the file's type"};
  return decoded;
}

}  // namespace palpate::io
