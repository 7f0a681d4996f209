#include "toolkit/io/pcd_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <string_view>

#include <palpate/result.h>
#include "toolkit/core/bytes.h"
#include "toolkit/io/decoding.h"

namespace palpate::io {
namespace {

constexpr std::size_t kMaxPcdHeaderBytes = std::size_t{1} << 20;
constexpr std::size_t kMaxFields = 256;
// Descriptors of some hundred floats exist; a point is never larger than this.
constexpr std::uint64_t kMaxPointBytes = std::uint64_t{1} << 16;
// PCL counts a cloud's bytes in 32 bits.
constexpr std::uint64_t kMaxCloudBytes = (std::uint64_t{1} << 31) - 1;
// The best that LZF (M. Lehmann) can do: 3 bytes stand for a match of 264.
constexpr std::uint64_t kLzfMaxRatio = 264 / 3;
constexpr std::size_t kCompressedSizes = 8;  // two 32-bit sizes stand before the compressed data

Error malformed_pcd(std::string what, std::int64_t line = 0) {
  return Error{
      "malformed PCD header: " + std::move(what), "check that the file is a PCD file and whole", {}, line};
}

// PcdLines of the text part, with their numbers.
struct PcdLines {
  std::string_view text;
  std::size_t at = 0;
  std::int64_t number = 0;
  char line_end = ends_lines_with_cr(text.substr(0, kMaxPcdHeaderBytes)) ? '\r' : '\n';
  bool next(std::string_view& line) {
    if (at >= text.size()) return false;
    const std::size_t end = std::min(text.find(line_end, at), text.size());
    line = trimmed(text.substr(at, end - at));
    at = std::min(end + 1, text.size());
    ++number;
    return true;
  }
};

std::vector<std::string_view> tokens_of(std::string_view rest) {
  std::vector<std::string_view> tokens;
  for (std::string_view token = next_token(rest); !token.empty(); token = next_token(rest))
    tokens.push_back(token);
  return tokens;
}

// The header's lines as they stand, before they are compared with each other.
struct Raw {
  std::vector<std::string_view> names, sizes, types, counts;
  std::optional<std::int64_t> width, height, points;
  std::optional<PcdData> data;
};

Status parse_number(std::string_view key, const std::vector<std::string_view>& values, std::int64_t line,
                    std::optional<std::int64_t>& out) {
  out = values.size() == 1 ? parse_whole(values[0]) : std::nullopt;
  if (!out || *out < 0) return malformed_pcd(fmt::format("{} needs one whole number from 0 on", key), line);
  return Done{};
}

Status parse_line(std::string_view line, std::int64_t number, Raw& raw) {
  std::string_view rest = line;
  const std::string_view key = next_token(rest);
  std::vector<std::string_view> values = tokens_of(rest);
  if (values.size() > kMaxFields)
    return malformed_pcd(fmt::format("more than {} values", kMaxFields), number);
  if (key == "FIELDS" || key == "COLUMNS") {
    raw.names = std::move(values);
  } else if (key == "SIZE") {
    raw.sizes = std::move(values);
  } else if (key == "TYPE") {
    raw.types = std::move(values);
  } else if (key == "COUNT") {
    raw.counts = std::move(values);
  } else if (key == "WIDTH") {
    return parse_number(key, values, number, raw.width);
  } else if (key == "HEIGHT") {
    return parse_number(key, values, number, raw.height);
  } else if (key == "POINTS") {
    return parse_number(key, values, number, raw.points);
  } else if (key == "DATA") {
    const std::string_view kind = values.empty() ? std::string_view() : values[0];
    if (kind == "ascii") {
      raw.data = PcdData::kAscii;
    } else if (kind == "binary") {
      raw.data = PcdData::kBinary;
    } else if (kind == "binary_compressed") {
      raw.data = PcdData::kCompressed;
    } else {
      return malformed_pcd(fmt::format("the data {} is not ascii, binary or binary_compressed", shown(kind)),
                           number);
    }
  } else if (key != "VERSION" && key != "VIEWPOINT") {
    return malformed_pcd(fmt::format("unknown keyword {}", shown(key)), number);
  }
  return Done{};
}

Status take_fields(const Raw& raw, PcdHeader& header) {
  if (raw.names.empty()) return malformed_pcd("no FIELDS");
  if (raw.sizes.size() != raw.names.size() || raw.types.size() != raw.names.size() ||
      (!raw.counts.empty() && raw.counts.size() != raw.names.size()))
    return malformed_pcd("FIELDS, SIZE, TYPE and COUNT differ in their number of values");
  int axes = 0;
  for (std::size_t i = 0; i < raw.names.size(); ++i) {
    PcdField field;
    field.name = raw.names[i];
    const std::int64_t bytes = parse_whole(raw.sizes[i]).value_or(0);
    const std::int64_t count = raw.counts.empty() ? 1 : parse_whole(raw.counts[i]).value_or(-1);
    field.type = raw.types[i].size() == 1 ? raw.types[i][0] : '?';
    const bool real = field.type == 'F' && (bytes == sizeof(float) || bytes == sizeof(double));
    const bool whole = (field.type == 'I' || field.type == 'U') &&
                       (bytes == 1 || bytes == 2 || bytes == sizeof(float) || bytes == sizeof(double));
    if (!real && !whole)
      return malformed_pcd(fmt::format("field {} has the type {} and size {}, which do not go together",
                                       shown(field.name), shown(raw.types[i]), shown(raw.sizes[i])));
    if (count < 0 || static_cast<std::uint64_t>(count) > kMaxPointBytes)
      return malformed_pcd(fmt::format("field {} has the count {}", shown(field.name), shown(raw.counts[i])));
    if (count == 0) continue;  // padding without bytes, as some writers leave behind
    field.bytes = static_cast<std::uint32_t>(bytes);
    field.count = static_cast<std::uint32_t>(count);
    header.point_bytes += std::uint64_t{field.bytes} * field.count;
    if (field.name == "x" || field.name == "y" || field.name == "z") axes += field.count == 1 ? 1 : 0;
    for (const PcdField& other : header.fields) {
      if (other.name == field.name && field.name != "_")
        return malformed_pcd(fmt::format("field {} stands twice", shown(field.name)));
    }
    header.fields.push_back(std::move(field));
  }
  if (axes != 3) return Error{"the PCD file has no scalar fields x, y and z", "check its FIELDS line"};
  if (header.point_bytes > kMaxPointBytes)
    return malformed_pcd(fmt::format("a point of {} bytes", header.point_bytes));
  return Done{};
}

Status take_size(const Raw& raw, PcdHeader& header) {
  if (!raw.width) return malformed_pcd("no WIDTH");
  const auto width = static_cast<std::uint64_t>(*raw.width);
  const auto height = static_cast<std::uint64_t>(raw.height.value_or(1));
  if (width > kMaxPoints || height > kMaxPoints || (height > 0 && width > kMaxPoints / height))
    return Error{
        fmt::format("the header promises {} x {} points, more than can be told apart", width, height),
        "check WIDTH and HEIGHT"};
  if (raw.points && static_cast<std::uint64_t>(*raw.points) != width * height)
    return malformed_pcd(fmt::format("POINTS is {}, but WIDTH x HEIGHT is {}", *raw.points, width * height));
  if (width * height == 0) return Error{"the file holds no points", "give a file with at least one point"};
  header.width = static_cast<std::uint32_t>(width);
  header.height = static_cast<std::uint32_t>(height);
  return Done{};
}

Error cut_off(const PcdHeader& header, std::uint64_t need, std::uint64_t have) {
  return Error{fmt::format("the header promises {} points, at least {} bytes, but only {} bytes follow it",
                           header.points(), need, have),
               "the file is cut off or its header is wrong: fetch it again"};
}

std::uint64_t values_per_point(const PcdHeader& header) {
  std::uint64_t total = 0;
  for (const PcdField& field : header.fields) total += field.count;
  return total;
}

// PCL would read what is not a number as 0 and does not say where.
Status check_ascii(const PcdHeader& header, PcdLines lines) {
  const std::uint64_t values = values_per_point(header);
  const std::uint64_t least = header.points() * 2 * values - 1;  // a digit and a separator each, bar the last
  const std::uint64_t have = lines.text.size() - lines.at;
  if (least > have) return cut_off(header, least, have);
  std::uint64_t rows = 0;
  std::string_view line;
  while (rows < header.points() && lines.next(line)) {
    if (line.empty()) continue;
    std::uint64_t found = 0;
    for (std::string_view token = next_token(line); !token.empty(); token = next_token(line)) {
      if (!parse_real(token))
        return Error{fmt::format("{} is not a number", shown(token)),
                     number_remedy(token, kCheckLine),
                     {},
                     lines.number};
      ++found;
    }
    if (found != values)
      return Error{fmt::format("the row has {} values, the header names {}", found, values),
                   kCheckLine,
                   {},
                   lines.number};
    ++rows;
  }
  if (rows == header.points()) return Done{};
  return Error{fmt::format("the file ends after {} of the {} promised points", rows, header.points()),
               "the file is cut off: fetch it again",
               {},
               lines.number};
}

Status check_binary(const PcdHeader& header, std::span<const std::byte> body) {
  const std::uint64_t need = header.points() * header.point_bytes;
  if (header.data == PcdData::kBinary) {
    if (body.size() < need) return cut_off(header, need, body.size());
    return Done{};
  }
  if (body.size() < kCompressedSizes) return cut_off(header, kCompressedSizes, body.size());
  ByteReader sizes(body);
  const std::uint64_t packed = sizes.u32();
  const std::uint64_t unpacked = sizes.u32();
  std::uint64_t padding = 0;  // PCL does not write it into compressed data
  for (const PcdField& field : header.fields) padding += field.name == "_" ? field.bytes * field.count : 0;
  if (packed > body.size() - kCompressedSizes)
    return Error{fmt::format("the compressed data should have {} bytes, but only {} follow", packed,
                             body.size() - kCompressedSizes),
                 "the file is cut off: fetch it again"};
  if (unpacked != need - header.points() * padding)
    return Error{fmt::format("the compressed data unpacks to {} bytes, the header promises {}", unpacked,
                             need - header.points() * padding),
                 "the header does not belong to this data: fetch the file again"};
  if (unpacked > packed * kLzfMaxRatio)
    return Error{fmt::format("{} compressed bytes cannot unpack to {}", packed, unpacked),
                 "the file is damaged: fetch it again"};
  return Done{};
}

std::string canonical_header(const PcdHeader& header) {
  std::string names, sizes, types, counts;
  for (const PcdField& field : header.fields) {
    names += " " + field.name;
    sizes += fmt::format(" {}", field.bytes);
    types += fmt::format(" {}", field.type);
    counts += fmt::format(" {}", field.count);
  }
  const char* const data = header.data == PcdData::kAscii    ? "ascii"
                           : header.data == PcdData::kBinary ? "binary"
                                                             : "binary_compressed";
  return fmt::format(
      "VERSION 0.7\nFIELDS{}\nSIZE{}\nTYPE{}\nCOUNT{}\nWIDTH {}\nHEIGHT {}\nVIEWPOINT 0 0 0 1 0 0 0\n"
      "POINTS {}\nDATA {}\n",
      names, sizes, types, counts, header.width, header.height, header.points(), data);
}

// The lines up to DATA and with it, where `lines` stands then.
Result<PcdHeader> parse_lines(PcdLines& lines) {
  Raw raw;
  std::string_view line;
  while (!raw.data) {
    if (lines.at > kMaxPcdHeaderBytes || !lines.next(line))
      return malformed_pcd("no DATA line; is this a PCD file?", lines.number);
    if (line.empty() || line.front() == '#') continue;
    PALPATE_TRY(parse_line(line, lines.number, raw));
  }
  PcdHeader header;
  header.data = *raw.data;
  header.body_at = lines.at;
  PALPATE_TRY(take_fields(raw, header));
  PALPATE_TRY(take_size(raw, header));
  return header;
}

Result<PcdLines> lines_of(std::span<const std::byte> file) {
  const std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
  PALPATE_ASSIGN(const std::size_t mark, byte_order_mark(text));
  return PcdLines{text, mark};
}

}  // namespace

Result<PcdHeader> parse_pcd_header(std::span<const std::byte> begin) {
  PALPATE_ASSIGN(PcdLines lines, lines_of(begin));
  return parse_lines(lines);
}

Result<PcdHeader> check_pcd(std::span<const std::byte> file, const ReadOptions& options) {
  PALPATE_ASSIGN(PcdLines lines, lines_of(file));
  PALPATE_ASSIGN(PcdHeader header, parse_lines(lines));
  if (header.points() > kMaxCloudBytes / header.point_bytes)
    return Error{
        fmt::format("the header promises {} points of {} bytes, more than the 2 GiB that PCL can hold",
                    header.points(), header.point_bytes),
        "check WIDTH and HEIGHT, or split the file"};
  // PCL unpacks into one buffer and copies to another.
  PALPATE_TRY(check_memory(header.points(), 2 * header.point_bytes + sizeof(Vec3), "points", options));
  PALPATE_TRY(header.data == PcdData::kAscii ? check_ascii(header, lines)
                                             : check_binary(header, file.subspan(header.body_at)));
  header.cr_ends_lines = header.data == PcdData::kAscii && lines.line_end == '\r';
  header.canonical = canonical_header(header);
  return header;
}

}  // namespace palpate::io
