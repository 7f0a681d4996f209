#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "toolkit/io/decoding.h"
#include "toolkit/io/ply_header.h"

namespace palpate::io {
namespace {

constexpr std::string_view kFaces = "face";
constexpr std::string_view kStrips = "tristrips";
constexpr std::string_view kGrid = "range_grid";

// An index as the file has it: whole, else -1, which no face may use.
std::int64_t to_index(double value) noexcept {
  constexpr double kEnd = 4294967296.0;  // 2^32: more than any index
  if (!(value >= 0.0) || value >= kEnd) return -1;
  const auto whole = static_cast<std::int64_t>(value);
  return static_cast<double>(whole) == value ? whole : -1;
}

// Takes the triangles of strips out of a list of corners: each corner closes one with the two before it,
// every second one turned, so that all face the same way; -1 ends a strip. A corner that stands twice in a
// triangle is how writers join two strips: no face.
class StripBuilder {
 public:
  explicit StripBuilder(FaceBuilder& faces) noexcept : faces_(faces) {}
  void begin() noexcept { length_ = 0; }
  [[nodiscard]] bool corner(double value) {
    constexpr double kEndOfStrip = -1.0;
    if (value == kEndOfStrip) {
      begin();
      return true;
    }
    const std::int64_t now = to_index(value);
    const bool flipped = length_ % 2 != 0;
    if (++length_ > 2 && now != last_ && now != before_ && last_ != before_) {
      faces_.begin();
      if (!faces_.corner(flipped ? last_ : before_) || !faces_.corner(flipped ? before_ : last_) ||
          !faces_.corner(now))
        return false;
      faces_.end();
    }
    before_ = last_;
    last_ = now;
    return true;
  }
  void end() const noexcept {}
  [[nodiscard]] Error error() const { return faces_.too_many(); }

 private:
  FaceBuilder& faces_;
  std::int64_t before_ = 0, last_ = 0;
  std::uint64_t length_ = 0;
};

// A polygon is its list.
struct PolygonBuilder {
  FaceBuilder& faces;
  void begin() noexcept { faces.begin(); }
  [[nodiscard]] bool corner(double value) { return faces.corner(to_index(value)); }
  void end() { faces.end(); }
  [[nodiscard]] Error error() const { return faces.too_many(); }
};

// Of a raster's positions, row by row, who stands there: a list of one point or none.
class GridBuilder {
 public:
  static constexpr std::uint32_t kNowhere = 0xFFFFFFFFu;
  explicit GridBuilder(std::size_t points) : position_of_(points, kNowhere) {}
  void begin() noexcept { at_position_ = 0; }
  [[nodiscard]] bool corner(double value) noexcept {
    const std::int64_t index = to_index(value);
    const auto point = static_cast<std::size_t>(index);
    once_ = once_ && at_position_++ == 0 && index >= 0 && point < position_of_.size() &&
            position_of_[point] == kNowhere;
    if (once_) {
      position_of_[point] = position_;
      ++placed_;
    }
    return true;  // a grid that tells nothing of its points takes nothing from them
  }
  void end() noexcept { ++position_; }
  [[nodiscard]] static Error error() { return {}; }
  // Nobody stands at two positions, no two at one, and everyone somewhere.
  [[nodiscard]] bool complete() const noexcept { return once_ && placed_ == position_of_.size(); }
  [[nodiscard]] std::vector<std::uint32_t> take() noexcept { return std::move(position_of_); }

 private:
  std::vector<std::uint32_t> position_of_;
  std::uint32_t position_ = 0;
  std::size_t at_position_ = 0, placed_ = 0;
  bool once_ = true;
};

// Hands out the values of one row in the order of its properties, whatever the format.
class Row {
 public:
  Row(BufferedInput& in, PlyFormat format)
      : in_(in),
        ascii_(format == PlyFormat::kAscii),
        swap_((format == PlyFormat::kBigEndian) != (std::endian::native == std::endian::big)) {}

  // Starts the next row; false at the end of the file or on an error.
  bool start() {
    if (!ascii_) return true;
    while (in_.next_line(line_)) {
      rest_ = line_;
      if (!trimmed(line_).empty()) return true;
    }
    return false;
  }
  bool value(PlyScalar type, double& out) {
    if (!ascii_) {
      const std::byte* at = in_.take(ply_bytes(type));
      if (at == nullptr) return false;
      out = ply_value(type, at, swap_);
      return true;
    }
    const std::string_view token = next_token(rest_);
    const std::optional<double> parsed = token.empty() ? std::nullopt : parse_real(token);
    if (!parsed) {
      bad_ = token.empty() ? std::string("the line has too few values for the header")
                           : fmt::format("{} is not a number", shown(token));
      remedy_ = number_remedy(token, remedy_);
      return false;
    }
    out = *parsed;
    return true;
  }
  // A list's count: whole and not negative.
  bool count(PlyScalar type, std::uint64_t& out) {
    double number = 0.0;
    if (!value(type, number)) return false;
    const std::int64_t whole = to_index(number);
    if (whole < 0) {
      bad_ = fmt::format("a list's count is {}, which is not a count", number);
      return false;
    }
    out = static_cast<std::uint64_t>(whole);
    return true;
  }
  // False where an ASCII line holds more than its row.
  bool finish() {
    if (!longer()) return true;
    bad_ = "the line has more values than the header names";
    return false;
  }
  // The same where nothing is lost by it: counted, for warn().
  void pass_over_rest() {
    if (longer() && longer_rows_++ == 0) first_longer_ = in_.line_number();
  }
  void warn(const PlyElement& element, DecodedFile& decoded) {
    if (longer_rows_ == 0) return;
    decoded.warnings.push_back(
        fmt::format("{} rows of element {} hold more values than the header names (the first is line {}); "
                    "what they hold beyond was passed over.",
                    longer_rows_, shown(element.name), first_longer_));
    longer_rows_ = 0;
  }
  // Counts what follows the last row: rows of text, or bytes, unless they are blank.
  Status pass_over_end(ReadMonitor& watch, DecodedFile& decoded) {
    std::uint64_t surplus = 0;
    bool blank = true;
    if (ascii_) {
      while (start()) {
        ++surplus;
        if (!watch.row()) return watch.error();
      }
      blank = surplus == 0;
    } else {
      while (const std::byte* at = in_.take(1)) {
        ++surplus;
        blank = blank && (*at == std::byte{'\n'} || is_blank(static_cast<char>(*at)));
        if (!watch.row()) return watch.error();
      }
    }
    if (in_.error()) return *in_.error();
    if (!blank)
      decoded.warnings.push_back(fmt::format("{} {} follow the last element; they were passed over.", surplus,
                                             ascii_ ? "rows" : "bytes"));
    return Done{};
  }
  const std::byte* block(std::size_t bytes) { return in_.take(bytes); }
  [[nodiscard]] bool ascii() const noexcept { return ascii_; }
  [[nodiscard]] bool swap() const noexcept { return swap_; }

  Error error(const PlyElement& element, std::uint64_t row) const {
    if (!bad_.empty()) return Error{bad_, remedy_, {}, ascii_ ? in_.line_number() : 0};
    Error error = in_.error_or({fmt::format("the file ends after {} of the {} promised rows of element {}",
                                            row, element.count, shown(element.name)),
                                "the file is cut off: fetch it again"});
    if (!ascii_) error.line = 0;
    return error;
  }

 private:
  [[nodiscard]] bool longer() const noexcept { return ascii_ && !trimmed(rest_).empty(); }

  BufferedInput& in_;
  bool ascii_;
  bool swap_;
  std::string_view line_;
  std::string_view rest_;
  std::string bad_;
  std::string remedy_ = "check the file at this place";
  std::uint64_t longer_rows_ = 0;
  std::int64_t first_longer_ = 0;
};

bool skip_list(Row& row, const PlyProperty& property, std::uint64_t count) {
  double ignored = 0.0;
  for (std::uint64_t i = 0; i < count; ++i) {
    if (!row.value(property.type, ignored)) return false;
  }
  return true;
}

bool skip_property(Row& row, const PlyProperty& property) {
  double ignored = 0.0;
  if (!property.is_list) return row.value(property.type, ignored);
  std::uint64_t count = 0;
  return row.count(property.count_type, count) && skip_list(row, property, count);
}

// Where a vertex property goes: a coordinate, a property of the cloud, or nowhere.
struct Target {
  int axis = -1;
  std::size_t property = 0;
  bool kept = false;
  std::size_t offset = 0;  // in a row without lists
};

std::vector<Target> vertex_targets(const PlyElement& element, DecodedFile& decoded) {
  constexpr std::string_view kAxes[] = {"x", "y", "z"};
  std::vector<Target> targets;
  std::size_t offset = 0;
  for (const PlyProperty& property : element.properties) {
    Target target;
    target.offset = offset;
    offset += ply_bytes(property.type);
    for (int axis = 0; axis < 3; ++axis) {
      if (!property.is_list && property.name == kAxes[axis]) target.axis = axis;
    }
    if (target.axis < 0 && !property.is_list) {
      target.kept = true;
      target.property = decoded.properties.size();
      decoded.properties.push_back({property.name, {}});
    }
    targets.push_back(target);
  }
  return targets;
}

Status read_vertices(const ReaderInput& input, BufferedInput& in, const PlyElement& element, Row& row,
                     DecodedFile& decoded) {
  const std::vector<Target> targets = vertex_targets(element, decoded);
  int axes = 0;
  for (const Target& target : targets) axes += target.axis >= 0 ? 1 : 0;
  decoded.single_precision = true;
  for (std::size_t p = 0; p < targets.size(); ++p)
    if (targets[p].axis >= 0 && element.properties[p].type != PlyScalar::kFloat32)
      decoded.single_precision = false;
  if (row.ascii()) decoded.single_precision = false;  // a text has the digits that it has
  if (axes != 3) return Error{"the element 'vertex' has no scalar properties x, y and z", "check the header"};
  if (Status fits = check_memory(element.count, sizeof(Vec3) + decoded.properties.size() * sizeof(float),
                                 "points", input.options);
      !fits)
    return fits;
  const std::size_t reserve =
      reserve_count(element.count, element.min_row_bytes(row.ascii()), in.remaining());
  decoded.points.reserve(reserve);
  for (cloud::Property& property : decoded.properties) property.values.reserve(reserve);

  ReadMonitor watch(input, in, decoded);
  const bool blocks = !row.ascii() && !element.has_lists();
  const std::size_t row_bytes = element.min_row_bytes(false);
  for (std::uint64_t i = 0; i < element.count; ++i) {
    Vec3 point = Vec3::Zero();
    const std::byte* block = nullptr;
    if (blocks ? (block = row.block(row_bytes)) == nullptr : !row.start()) return row.error(element, i);
    for (std::size_t p = 0; p < targets.size(); ++p) {
      const PlyProperty& property = element.properties[p];
      const Target& target = targets[p];
      double value = 0.0;
      if (block != nullptr) {
        value = ply_value(property.type, block + target.offset, row.swap());
      } else if (property.is_list) {
        if (!skip_property(row, property)) return row.error(element, i);
        continue;
      } else if (!row.value(property.type, value)) {
        return row.error(element, i);
      }
      if (target.axis >= 0)
        point[target.axis] = value;
      else
        decoded.properties[target.property].values.push_back(to_float(value));
    }
    if (!row.finish()) return row.error(element, i);
    decoded.points.push_back(point);
    if (!watch.row()) return watch.error();
  }
  return Done{};
}

bool is_corner_list(const PlyProperty& property) {
  return property.is_list && (property.name == "vertex_indices" || property.name == "vertex_index");
}

Status skip_element(const ReaderInput& input, BufferedInput& in, const PlyElement& element, Row& row,
                    DecodedFile& decoded) {
  ReadMonitor watch(input, in, decoded);
  if (element.properties.empty()) return Done{};  // such rows have no bytes, however many are promised
  for (std::uint64_t i = 0; i < element.count; ++i) {
    if (!row.start()) return row.error(element, i);
    for (const PlyProperty& property : element.properties) {
      if (!skip_property(row, property)) return row.error(element, i);
    }
    row.pass_over_rest();
    if (!watch.row()) return watch.error();
  }
  row.warn(element, decoded);
  return Done{};
}

// Hands the corner lists of an element to `builder`, which says why where it takes no more.
template <class Builder>
Status read_corners(Row& row, const PlyElement& element, ReadMonitor& watch, Builder& builder) {
  for (std::uint64_t i = 0; i < element.count; ++i) {
    if (!row.start()) return row.error(element, i);
    for (const PlyProperty& property : element.properties) {
      if (!is_corner_list(property)) {
        if (!skip_property(row, property)) return row.error(element, i);
        continue;
      }
      std::uint64_t count = 0;
      if (!row.count(property.count_type, count)) return row.error(element, i);
      builder.begin();
      for (std::uint64_t c = 0; c < count; ++c) {
        double index = 0.0;
        if (!row.value(property.type, index)) return row.error(element, i);
        if (!builder.corner(index)) return builder.error();
        if (!watch.row()) return watch.error();  // one list may be all the file's strips
      }
      builder.end();
    }
    row.pass_over_rest();
    if (!watch.row()) return watch.error();
  }
  return Done{};
}

Status read_faces(const ReaderInput& input, BufferedInput& in, const PlyElement& element,
                  std::uint64_t vertices, Row& row, DecodedFile& decoded) {
  if (std::none_of(element.properties.begin(), element.properties.end(), is_corner_list)) {
    decoded.warnings.push_back(fmt::format(
        "The element {} has no list vertex_indices: no faces are read from it.", shown(element.name)));
    return skip_element(input, in, element, row, decoded);
  }
  ReadMonitor watch(input, in, decoded);
  FaceBuilder faces(decoded, vertices, input.options);
  Status read = Done{};
  if (element.name == kStrips) {
    StripBuilder strips(faces);
    read = read_corners(row, element, watch, strips);
  } else {
    decoded.triangles.reserve(
        std::min(reserve_count(element.count, element.min_row_bytes(row.ascii()), in.remaining()),
                 static_cast<std::size_t>(input.options.max_bytes / sizeof(decoded.triangles[0]))));
    PolygonBuilder polygons{faces};
    read = read_corners(row, element, watch, polygons);
  }
  row.warn(element, decoded);
  return read;
}

// Whether the element lists, for each position of the header's raster row by row, who stands there.
bool is_grid(const PlyHeader& header, const PlyElement& element) {
  return element.name == kGrid && header.columns > 0 && header.rows > 0 && element.count <= kMaxPoints &&
         header.columns * header.rows == element.count &&
         std::count_if(element.properties.begin(), element.properties.end(), is_corner_list) == 1;
}

// Positions of the points, which are read already.
Status read_grid(const ReaderInput& input, BufferedInput& in, const PlyElement& element, Row& row,
                 DecodedFile& decoded) {
  const std::size_t points = decoded.points.size();
  if (Status fits = check_memory(points, sizeof(std::uint32_t), "positions of points", input.options); !fits)
    return fits;
  GridBuilder grid(points);
  ReadMonitor watch(input, in, decoded);
  if (Status read = read_corners(row, element, watch, grid); !read) return read;
  row.warn(element, decoded);
  if (grid.complete())
    decoded.position_of = grid.take();
  else
    decoded.warnings.push_back(fmt::format(
        "The element {} does not list every point once: rows and columns are not known.", shown(kGrid)));
  return Done{};
}

// A Cyberware file whose grid has no holes lists its points row by row, or says so of each.
void take_raster(const PlyHeader& header, bool has_grid_element, DecodedFile& decoded) {
  if (header.columns == 0 || header.rows == 0) return;
  const cloud::ScanRaster raster{static_cast<std::uint32_t>(header.columns),
                                 static_cast<std::uint32_t>(header.rows)};
  const std::uint64_t positions = header.columns * header.rows;
  std::vector<std::uint32_t>& of = decoded.position_of;
  bool in_order = positions == decoded.points.size() && (!has_grid_element || !of.empty());
  for (std::size_t i = 0; in_order && i < of.size(); ++i) in_order = of[i] == i;
  if (in_order) {
    decoded.raster = raster;
    of.clear();
  }
  decoded.position_columns = raster.columns;
}

}  // namespace

Result<DecodedFile> read_ply(const ReaderInput& input) {
  BufferedInput in(input.bytes);
  PALPATE_ASSIGN(const PlyHeader header, read_ply_header(in));
  DecodedFile decoded;
  decoded.format = format_name(header.format);
  decoded.unit = header.unit;

  const PlyElement* vertex = nullptr;
  std::size_t wanted = 0;  // elements that must be read still
  bool has_grid = false;
  for (const PlyElement& element : header.elements) {
    if (element.name == "vertex") vertex = &element;
    // A grid before the points, if there is such a file, is passed over.
    const bool grid = vertex != nullptr && is_grid(header, element);
    if (element.name == "vertex" || element.name == kFaces || element.name == kStrips || grid) ++wanted;
    has_grid = has_grid || element.name == kGrid;
  }
  if (vertex == nullptr)
    return Error{"the PLY file has no element 'vertex'", "check that it holds points", {}, in.line_number()};

  Row row(in, header.format);
  std::size_t elements = 0;  // read or passed over
  for (const PlyElement& element : header.elements) {
    if (wanted == 0) break;
    ++elements;
    Status read = Done{};
    if (element.name == "vertex") {
      read = read_vertices(input, in, element, row, decoded);
      --wanted;
    } else if (element.name == kFaces || element.name == kStrips) {
      read = read_faces(input, in, element, vertex->count, row, decoded);
      --wanted;
    } else if (!decoded.points.empty() && is_grid(header, element)) {
      read = read_grid(input, in, element, row, decoded);
      --wanted;
    } else {
      read = skip_element(input, in, element, row, decoded);
    }
    if (!read) return std::move(read).error();
  }
  if (elements == header.elements.size()) {
    ReadMonitor watch(input, in, decoded);
    PALPATE_TRY(row.pass_over_end(watch, decoded));
  }
  take_raster(header, has_grid, decoded);
  return decoded;
}

}  // namespace palpate::io
