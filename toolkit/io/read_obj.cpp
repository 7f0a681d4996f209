// OBJ (Wavefront Technologies, Advanced Visualizer manual, appendix B1): v and f; all else is passed over.
#include <fmt/format.h>

#include <array>

#include <palpate/result.h>
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

// OFF (Geomview manual, section "OFF Files"): ASCII, with the variants that put colours, normals or texture
// coordinates behind the position of a vertex.

namespace {

Error at_line(const BufferedInput& in, std::string what, std::string remedy = kCheckLine) {
  return in.error_or({std::move(what), std::move(remedy)});
}

// The next line that holds anything, without its comment.
bool next_off_row(BufferedInput& in, std::string_view& row) {
  while (in.next_line(row)) {
    row = trimmed(row.substr(0, row.find('#')));
    if (!row.empty()) return true;
  }
  return false;
}

struct Counts {
  std::uint64_t vertices = 0;
  std::uint64_t faces = 0;
};

// The first line: the keyword, with the counts behind it or (as some writers have it) glued to it.
Result<std::string_view> after_keyword(const BufferedInput& in, std::string_view row) {
  std::size_t letters = 0;
  while (letters < row.size() && !is_blank(row[letters]) &&
         (row[letters] < '0' || row[letters] > '9' || letters == 0))
    ++letters;
  const std::string_view keyword = row.substr(0, letters);
  constexpr std::array<std::string_view, 8> kKnown{"OFF",   "COFF",   "NOFF",   "CNOFF",
                                                   "STOFF", "STCOFF", "STNOFF", "STCNOFF"};
  for (const std::string_view known : kKnown) {
    if (keyword != known) continue;
    const std::string_view rest = trimmed(row.substr(letters));
    if (lower_case(rest.substr(0, rest.find(' '))) == "binary")
      return at_line(in, "binary OFF files are not understood");
    return rest;
  }
  if (keyword == "4OFF" || keyword.ends_with("nOFF"))
    return at_line(in, fmt::format("the OFF variant {} has no three-dimensional points", shown(keyword)));
  return at_line(in, "this is no OFF file: it does not start with OFF");
}

Result<Counts> read_counts(BufferedInput& in, std::string_view rest) {
  if (rest.empty() && !next_off_row(in, rest))
    return at_line(in, "the file ends before the counts of vertices and faces");
  std::array<std::uint64_t, 2> numbers{};
  for (std::uint64_t& number : numbers) {
    const std::string_view token = next_token(rest);
    const std::optional<std::int64_t> value = parse_whole(token);
    if (!value || *value < 0)
      return at_line(in, fmt::format("malformed OFF header: {} is not a count", shown(token)));
    number = static_cast<std::uint64_t>(*value);
  }
  return Counts{numbers[0], numbers[1]};  // the count of edges may follow and means nothing
}

Status check_promise(const BufferedInput& in, const Counts& counts, const ReadOptions& options) {
  PALPATE_TRY(check_memory(counts.vertices, sizeof(Vec3), "vertices", options));
  const std::optional<std::uint64_t> remaining = in.remaining();
  if (!remaining) return Done{};
  constexpr std::uint64_t kVertexBytes = 6;  // "0 0 0" and the end of the line
  constexpr std::uint64_t kFaceBytes = 2;    // "0" and the end of the line
  const std::uint64_t room = *remaining + 1;
  if (counts.vertices > room / kVertexBytes ||
      counts.faces > (room - counts.vertices * kVertexBytes) / kFaceBytes)
    return Error{fmt::format("the header promises {} vertices and {} faces, but only {} bytes follow it",
                             counts.vertices, counts.faces, *remaining),
                 "the file is cut off or its header is wrong: fetch it again",
                 {},
                 in.line_number()};
  return Done{};
}

Status ends_early(const BufferedInput& in, std::uint64_t have, std::uint64_t promised,
                  std::string_view what) {
  return in.error_or({fmt::format("the file ends after {} of the {} promised {}", have, promised, what),
                      "the file is cut off: fetch it again"});
}

Status read_vertices(BufferedInput& in, std::uint64_t count, ReadMonitor& watch, DecodedFile& decoded) {
  std::string_view row;
  for (std::uint64_t i = 0; i < count; ++i) {
    if (!next_off_row(in, row)) return ends_early(in, i, count, "vertices");
    const Result<Vec3> point = next_vertex(row);
    if (!point) return at_line(in, point.error().what, point.error().remedy);
    decoded.points.push_back(*point);
    if (!watch.row()) return watch.error();
  }
  return Done{};
}

Status read_faces(BufferedInput& in, std::uint64_t count, ReadMonitor& watch, FaceBuilder& faces) {
  std::string_view row;
  for (std::uint64_t i = 0; i < count; ++i) {
    if (!next_off_row(in, row)) return ends_early(in, i, count, "faces");
    std::string_view token = next_token(row);
    const std::optional<std::int64_t> corners = parse_whole(token);
    if (!corners || *corners < 0)
      return at_line(in, fmt::format("{} is not a face's number of corners", shown(token)));
    faces.begin();
    for (std::int64_t c = 0; c < *corners; ++c) {
      token = next_token(row);
      if (token.empty())
        return at_line(in, fmt::format("a face promises {} corners and has {}", *corners, c));
      const std::optional<std::int64_t> index = parse_whole(token);
      if (!index) return at_line(in, fmt::format("the corner {} of a face is not an index", shown(token)));
      if (!faces.corner(*index)) return faces.too_many();
    }
    faces.end();
    if (!watch.row()) return watch.error();
  }
  return Done{};
}

}  // namespace

Result<DecodedFile> read_off(const ReaderInput& input) {
  BufferedInput in(input.bytes);
  std::string_view row;
  if (!next_off_row(in, row)) return at_line(in, "this is no OFF file: it does not start with OFF");
  PALPATE_ASSIGN(const std::string_view rest, after_keyword(in, row));
  PALPATE_ASSIGN(const Counts counts, read_counts(in, rest));
  PALPATE_TRY(check_promise(in, counts, input.options));

  DecodedFile decoded;
  decoded.format = "OFF";
  constexpr std::uint64_t kVertexBytes = 6;  // as in check_promise
  decoded.points.reserve(reserve_count(counts.vertices, kVertexBytes, in.remaining()));
  ReadMonitor watch(input, in, decoded);
  PALPATE_TRY(read_vertices(in, counts.vertices, watch, decoded));
  FaceBuilder faces(decoded, counts.vertices, input.options);
  PALPATE_TRY(read_faces(in, counts.faces, watch, faces));
  return decoded;
}

}  // namespace palpate::io
