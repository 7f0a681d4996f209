#include "toolkit/io/ply_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <string_view>

#include <palpate/result.h>
#include "toolkit/io/decoding.h"

namespace palpate::io {
namespace {

// Thousands of comment lines fit; a binary file that only starts like a PLY does not go on for long.
constexpr std::size_t kMaxPlyHeaderBytes = std::size_t{1} << 20;
// A row's fixed part must fit into one block of BufferedInput::take; real files have some dozen properties.
constexpr std::size_t kMaxProperties = 4096;
constexpr std::size_t kMaxElements = 256;

/// Both names of each PlyScalar, and its bytes, in its order.
struct PlyType {
  std::array<std::string_view, 2> names;
  std::uint32_t bytes;
};
constexpr std::array<PlyType, 8> kPlyTypes{{{{"char", "int8"}, 1},
                                            {{"uchar", "uint8"}, 1},
                                            {{"short", "int16"}, 2},
                                            {{"ushort", "uint16"}, 2},
                                            {{"int", "int32"}, 4},
                                            {{"uint", "uint32"}, 4},
                                            {{"float", "float32"}, 4},
                                            {{"double", "float64"}, 8}}};
/// The header's and our own name of each PlyFormat, in its order.
constexpr std::array<std::array<std::string_view, 2>, 3> kPlyFormats{
    {{"ascii", "PLY, ASCII"},
     {"binary_little_endian", "PLY, binary little-endian"},
     {"binary_big_endian", "PLY, binary big-endian"}}};

std::optional<PlyScalar> type_of(std::string_view name) {
  for (std::size_t i = 0; i < kPlyTypes.size(); ++i)
    if (name == kPlyTypes[i].names[0] || name == kPlyTypes[i].names[1]) return static_cast<PlyScalar>(i);
  return std::nullopt;
}

Error malformed_ply(std::string what) {
  return Error{"malformed PLY header: " + std::move(what), "check that the file is a PLY file and whole"};
}

Status parse_format(std::string_view rest, PlyHeader& header) {
  const std::string_view name = next_token(rest);
  const std::string_view version = next_token(rest);
  const auto* const found =
      std::find_if(kPlyFormats.begin(), kPlyFormats.end(), [&](const auto& row) { return row[0] == name; });
  if (found == kPlyFormats.end())
    return malformed_ply(
        fmt::format("the format {} is not ascii, binary_little_endian or binary_big_endian", shown(name)));
  header.format = static_cast<PlyFormat>(found - kPlyFormats.begin());
  if (version != "1.0") return malformed_ply(fmt::format("the version {} is not 1.0", shown(version)));
  return Done{};
}

Status parse_element(std::string_view rest, PlyHeader& header) {
  PlyElement element;
  element.name = next_token(rest);
  const std::string_view format_count = next_token(rest);
  const std::optional<std::int64_t> count = parse_whole(format_count);
  if (element.name.empty() || !count || *count < 0)
    return malformed_ply(fmt::format("the count {} of element {} is not a whole number from 0 on",
                                     shown(format_count), shown(element.name)));
  element.count = static_cast<std::uint64_t>(*count);
  for (const PlyElement& other : header.elements) {
    if (other.name == element.name)
      return malformed_ply(fmt::format("element {} stands twice", shown(element.name)));
  }
  if (header.elements.size() >= kMaxElements) return malformed_ply("too many elements");
  header.elements.push_back(std::move(element));
  return Done{};
}

Status parse_property(std::string_view rest, PlyHeader& header) {
  if (header.elements.empty()) return malformed_ply("a property before the first element");
  PlyProperty property;
  std::string_view type_name = next_token(rest);
  if (type_name == "list") {
    property.is_list = true;
    const std::string_view count_name = next_token(rest);
    const std::optional<PlyScalar> count_type = type_of(count_name);
    if (!count_type || *count_type == PlyScalar::kFloat32 || *count_type == PlyScalar::kFloat64)
      return malformed_ply(fmt::format("{} is no type for a list's count", shown(count_name)));
    property.count_type = *count_type;
    type_name = next_token(rest);
  }
  const std::optional<PlyScalar> type = type_of(type_name);
  if (!type) return malformed_ply(fmt::format("unknown type {}", shown(type_name)));
  property.type = *type;
  property.name = next_token(rest);
  if (property.name.empty()) return malformed_ply("a property without a name");
  std::vector<PlyProperty>& properties = header.elements.back().properties;
  if (properties.size() >= kMaxProperties) return malformed_ply("too many properties");
  for (const PlyProperty& other : properties) {
    if (other.name == property.name)
      return malformed_ply(fmt::format("property {} stands twice", shown(other.name)));
  }
  properties.push_back(std::move(property));
  return Done{};
}

// "unit mm" in a comment, and the raster of Cyberware scanners; everything else is for people.
void parse_remark(std::string_view rest, PlyHeader& header) {
  const std::string key = lower_case(next_token(rest));
  const std::string_view value = next_token(rest);
  if (key == "unit" || key == "unit:" || key == "units" || key == "units:") {
    if (const Result<Unit> unit = parse_unit(value)) header.unit = *unit;
  } else if (key == "num_cols" || key == "num_rows") {
    const std::optional<std::int64_t> number = parse_whole(value);
    const bool usable = number && *number > 0 && *number <= std::numeric_limits<std::int32_t>::max();
    (key == "num_cols" ? header.columns : header.rows) = usable ? static_cast<std::uint64_t>(*number) : 0;
  }
}

Status check_promises(const PlyHeader& header, const BufferedInput& in) {
  const std::optional<std::uint64_t> remaining = in.remaining();
  if (!remaining) return Done{};
  // The last line of text may lack its end.
  std::uint64_t left = *remaining + (header.format == PlyFormat::kAscii ? 1 : 0);
  for (const PlyElement& element : header.elements) {
    const std::uint64_t each = element.min_row_bytes(header.format == PlyFormat::kAscii);
    if (each == 0) continue;
    if (element.count > left / each)
      return Error{
          fmt::format("the header promises {} rows of element {}, at least {} bytes each, but only {} bytes "
                      "follow it",
                      element.count, shown(element.name), each, *remaining),
          "the file is cut off or its header is wrong: fetch it again"};
    left -= element.count * each;
  }
  return Done{};
}

template <class T>
double load(const std::byte* at, bool swap) noexcept {
  std::array<std::byte, sizeof(T)> bytes;
  std::memcpy(bytes.data(), at, sizeof(T));
  if (swap) std::reverse(bytes.begin(), bytes.end());
  return static_cast<double>(std::bit_cast<T>(bytes));
}

}  // namespace

std::uint32_t ply_bytes(PlyScalar type) noexcept {
  return kPlyTypes[static_cast<std::size_t>(type)].bytes;
}

double ply_value(PlyScalar type, const std::byte* at, bool swap) noexcept {
  switch (type) {
    case PlyScalar::kInt8:
      return load<std::int8_t>(at, swap);
    case PlyScalar::kUint8:
      return load<std::uint8_t>(at, swap);
    case PlyScalar::kInt16:
      return load<std::int16_t>(at, swap);
    case PlyScalar::kUint16:
      return load<std::uint16_t>(at, swap);
    case PlyScalar::kInt32:
      return load<std::int32_t>(at, swap);
    case PlyScalar::kUint32:
      return load<std::uint32_t>(at, swap);
    case PlyScalar::kFloat32:
      return load<float>(at, swap);
    case PlyScalar::kFloat64:
      break;
  }
  return load<double>(at, swap);
}

std::string format_name(PlyFormat format) {
  return std::string(kPlyFormats[static_cast<std::size_t>(format)][1]);
}

bool PlyElement::has_lists() const noexcept {
  return std::any_of(properties.begin(), properties.end(), [](const PlyProperty& p) { return p.is_list; });
}

std::uint64_t PlyElement::min_row_bytes(bool ascii) const noexcept {
  std::uint64_t total = 0;
  // ASCII: one digit and one separator a value. An empty list is its count alone.
  for (const PlyProperty& p : properties) total += ascii ? 2 : ply_bytes(p.is_list ? p.count_type : p.type);
  return total;
}

Result<PlyHeader> read_ply_header(BufferedInput& in) {
  std::string_view line;
  if (!in.next_line(line) || trimmed(line) != "ply")
    return in.error_or({"this is no PLY file: its first line is not 'ply'", "check the file's type", {}, 1});
  PlyHeader header;
  bool have_format = false;
  std::size_t bytes = 0;
  while (in.next_line(line)) {
    bytes += line.size() + 1;
    if (bytes > kMaxPlyHeaderBytes)
      return malformed_ply(fmt::format("no end_header within {} bytes", kMaxPlyHeaderBytes))
          .in_file({}, in.line_number());
    std::string_view rest = line;
    const std::string_view key = next_token(rest);
    Status parsed = Done{};
    if (key == "end_header") {
      if (!have_format) return malformed_ply("no format line").in_file({}, in.line_number());
      PALPATE_TRY(check_promises(header, in));
      return header;
    }
    if (key == "format") {
      parsed = parse_format(rest, header);
      have_format = true;
    } else if (key == "element") {
      parsed = parse_element(rest, header);
    } else if (key == "property") {
      parsed = parse_property(rest, header);
    } else if (key == "comment" || key == "obj_info") {
      parse_remark(rest, header);
    } else if (!key.empty()) {
      parsed = malformed_ply(fmt::format("unknown keyword {}", shown(key)));
    }
    if (!parsed) return std::move(parsed).error().in_file({}, in.line_number());
  }
  return in.error_or(malformed_ply("the file ends before end_header"));
}

}  // namespace palpate::io
