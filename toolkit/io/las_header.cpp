#include "toolkit/io/las_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <string_view>
#include <tuple>
#include <utility>

#include "toolkit/core/bytes.h"
#include "toolkit/io/decoding.h"

namespace palpate::io {

// ---- the unit of positions

namespace {

// GeoTIFF keys and their values, by number (OGC 19-008, EPSG's units of measure).
constexpr std::uint16_t kModelTypeKey = 1024, kLinearUnitKey = 3076, kVerticalUnitKey = 4099;
constexpr std::uint16_t kGeographicModel = 2;
struct EpsgUnit {
  std::uint16_t code;
  double metres;
};
constexpr double kFoot = 0.3048, kUsSurveyFoot = 1200.0 / 3937.0;
constexpr EpsgUnit kEpsgUnits[] = {{9001, 1.0},   {9002, kFoot}, {9003, kUsSurveyFoot},
                                   {1025, 0.001}, {1033, 0.01},  {9036, 1000.0}};

struct KnownLength {
  double metres;
  std::optional<Unit> unit;
  const char* name;
};
constexpr KnownLength kKnownLengths[] = {
    {1.0, Unit::kMetre, "metres"},
    {0.01, Unit::kCentimetre, "centimetres"},
    {0.001, Unit::kMillimetre, "millimetres"},
    {0.0254, Unit::kInch, "inches"},
    {kFoot, std::nullopt, "feet"},
    {kUsSurveyFoot, std::nullopt, "US survey feet"},
};
// The two feet differ by 2e-6 of their length; texts give at least eight digits.
constexpr double kSameLength = 2e-7;

bool same_length(double a, double b) {
  return std::abs(a - b) <= kSameLength * b;
}

// The unit that the file states, whichever way it does.
struct StatedUnit {
  std::optional<double> metres, vertical_metres;
  bool geographic = false;
};

StatedUnit stated_by_keys(std::span<const std::byte> keys) {
  StatedUnit stated;
  ByteReader in(keys);
  (void)in.u16();  // versions of the directory, the keys and their revision
  (void)in.u32();
  const std::uint16_t count = in.u16();
  for (std::uint16_t i = 0; i < count; ++i) {
    const std::uint16_t key = in.u16(), elsewhere = in.u16();
    (void)in.u16();  // count of values
    const std::uint16_t value = in.u16();
    if (!in.good()) break;
    if (elsewhere != 0) continue;
    if (key == kModelTypeKey) stated.geographic = value == kGeographicModel;
    if (key != kLinearUnitKey && key != kVerticalUnitKey) continue;
    for (const EpsgUnit& unit : kEpsgUnits)
      if (unit.code == value) (key == kLinearUnitKey ? stated.metres : stated.vertical_metres) = unit.metres;
  }
  return stated;
}

template <std::size_t N>
bool is_one_of(std::string_view word, const std::array<std::string_view, N>& words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}
constexpr std::array<std::string_view, 7> kHorizontalSystems{
    "PROJCS", "PROJCRS", "PROJECTEDCRS", "LOCAL_CS", "ENGCRS", "ENGINEERINGCRS", "GEOCCS"};
constexpr std::array<std::string_view, 4> kVerticalSystems{"VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS"};
constexpr std::array<std::string_view, 5> kGeographicSystems{"GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS",
                                                             "GEODETICCRS"};
constexpr std::array<std::string_view, 2> kAxisWords{"CS", "AXIS"};
constexpr std::array<std::string_view, 2> kUnitWords{"UNIT", "LENGTHUNIT"};

StatedUnit stated_by_text(std::string_view text) {
  StatedUnit stated;
  stated.metres = metres_of_text(text, false);
  stated.vertical_metres = metres_of_text(text, true);
  const auto holds = [&](std::string_view word) { return text.find(word) != std::string_view::npos; };
  stated.geographic = std::any_of(kGeographicSystems.begin(), kGeographicSystems.end(), holds) &&
                      std::none_of(kHorizontalSystems.begin(), kHorizontalSystems.end(), holds);
  return stated;
}

bool states_something(const StatedUnit& stated) {
  return stated.metres || stated.geographic;
}

}  // namespace

std::optional<double> metres_of_text(std::string_view text, bool vertical) {
  // Words with brackets, from the outermost one to where `at` stands.
  struct Open {
    std::string_view word;
    int commas = 0;
  };
  constexpr std::size_t kDeepest = 32;  // real texts reach eight
  std::vector<Open> open;
  const auto is_letter = [](char c) { return (c >= 'A' && c <= 'Z') || c == '_'; };
  const auto ends_number = [](char c) { return c == ',' || c == ']' || c == ')' || c == ' ' || c == '\n'; };
  std::size_t at = 0;
  while (at < text.size()) {
    const char c = text[at];
    if (c == '"') {
      at = text.find('"', at + 1);
      if (at == std::string_view::npos) return std::nullopt;
      ++at;
    } else if (is_letter(c)) {
      const std::size_t begin = at;
      while (at < text.size() && (is_letter(text[at]) || (text[at] >= '0' && text[at] <= '9'))) ++at;
      if (at < text.size() && (text[at] == '[' || text[at] == '(')) {
        if (open.size() == kDeepest) return std::nullopt;
        open.push_back({text.substr(begin, at - begin), 0});
        ++at;
      }
    } else if (c == ']' || c == ')') {
      if (!open.empty()) open.pop_back();
      ++at;
    } else if (c == ',') {
      if (!open.empty()) ++open.back().commas;
      ++at;
    } else if (open.size() > 1 && open.back().commas == 1 && is_one_of(open.back().word, kUnitWords) &&
               !is_blank(c) && c != '\n') {
      std::size_t end = at;
      while (end < text.size() && !ends_number(text[end])) ++end;
      // Units of axes are those of their system; those of anything else in it (a parameter) are their own.
      auto owner = open.rbegin() + 1;
      while (owner != open.rend() && is_one_of(owner->word, kAxisWords)) ++owner;
      const bool wanted = owner != open.rend() && (vertical ? is_one_of(owner->word, kVerticalSystems)
                                                            : is_one_of(owner->word, kHorizontalSystems));
      const std::optional<double> metres = parse_real(text.substr(at, end - at));
      if (wanted && metres && *metres > 0.0 && std::isfinite(*metres)) return metres;
      at = std::max(end, at + 1);
    } else {
      ++at;
    }
  }
  return std::nullopt;
}

LasUnit unit_of_las(std::span<const std::byte> keys, std::string_view text, bool prefers_text) {
  const StatedUnit by_text = stated_by_text(text), by_keys = stated_by_keys(keys);
  const auto& [first, second] = prefers_text ? std::tie(by_text, by_keys) : std::tie(by_keys, by_text);
  const StatedUnit& stated = states_something(first) ? first : second;
  LasUnit found;
  found.conventional_unit = Unit::kMetre;
  if (!stated.metres && stated.geographic) {
    found.warnings.emplace_back(
        "The file's positions are longitudes and latitudes in degrees, beside heights in a length: their "
        "shape is not that of the scanned thing. Project it first: pdal translate in out --filters "
        "filters.reprojection --filters.reprojection.out_srs=EPSG:CODE.");
    return found;
  }
  if (!stated.metres) return found;
  const auto* const known =
      std::find_if(std::begin(kKnownLengths), std::end(kKnownLengths),
                   [&](const KnownLength& length) { return same_length(length.metres, *stated.metres); });
  const std::string name = known != std::end(kKnownLengths) ? known->name : "another unit";
  if (known != std::end(kKnownLengths) && known->unit) {
    found.unit = known->unit;
  } else {
    found.warnings.push_back(fmt::format(
        "The file's lengths are in {}, {:.12g} m each, and are read as metres: for their true size "
        "read it with --unit m and multiply --scale by {:.12g}.",
        name, *stated.metres, *stated.metres));
  }
  if (stated.vertical_metres && !same_length(*stated.vertical_metres, *stated.metres))
    found.warnings.push_back(fmt::format(
        "The file's heights are in a unit of {:.12g} m, its x and y in one of {:.12g} m: heights are "
        "read in the unit of x and y.",
        *stated.vertical_metres, *stated.metres));
  return found;
}

// ---- the header

namespace {

constexpr std::size_t kHeader10Bytes = 227, kHeader13Bytes = 235, kHeader14Bytes = 375;
constexpr std::uint8_t kLastMinorVersion = 4;
// Where fields stand that are not read one after the other.
constexpr std::size_t kEncodingAt = 6, kVersionAt = 24, kSizesAt = 94, kScalesAt = 131, kEvlrsAt = 235;
constexpr std::uint16_t kTextFlag = 1u << 4;  // of the encoding: the coordinate system stands as text
// Bits that LASzip sets in the point format of what it compressed.
constexpr std::uint8_t kCompressedFlag = 0x80, kFormatMask = 0x3F;
constexpr std::size_t kVlrBytes = 54, kEvlrBytes = 60, kUserBytes = 16;
// A record beyond this is no coordinate system.
constexpr std::uint64_t kMostRecordBytes = std::uint64_t{1} << 20;
constexpr const char* kProjectionUser = "LASF_Projection";
constexpr std::uint16_t kKeysRecord = 34735, kTextRecord = 2112;
constexpr const char* kCopcUser = "copc";
constexpr std::uint16_t kCopcRecord = 1;
constexpr const char* kDamagedHeaderRemedy =
    "the header is damaged: fetch the file again, or repair it with lasinfo -repair";

// Bytes of a point and where its colour stands, by format.
struct LasFormatRow {
  std::size_t bytes, colour_at;
};
constexpr LasFormatRow kLasFormats[] = {{20, 0}, {28, 0},  {26, 20}, {34, 28}, {57, 0}, {63, 28},
                                        {30, 0}, {36, 30}, {38, 30}, {59, 0},  {67, 30}};
constexpr std::uint8_t kFirstLayeredFormat = 6;

// Values collected from the records.
struct LasRecords {
  std::vector<std::byte> compression;
  std::uint64_t compression_at = 0;
  std::vector<std::byte> keys;
  std::string text;
  bool copc = false;
};

// A record's name and place.
struct LasRecord {
  std::string_view user;
  std::uint16_t number = 0;
  std::uint64_t at = 0, bytes = 0;
};

Status take_las_record(const RandomAccess& file, const LasRecord& record, LasRecords& found) {
  const auto is = [&](const char* user, std::uint16_t number) {
    return record.user == user && record.number == number;
  };
  found.copc = found.copc || is(kCopcUser, kCopcRecord);
  const bool text = is(kProjectionUser, kTextRecord), keys = is(kProjectionUser, kKeysRecord);
  const bool compression = is(laz::kLaszipUser, laz::kLaszipRecord);
  if ((!text && !keys && !compression) || record.bytes > kMostRecordBytes) return Done{};
  std::vector<std::byte> content(static_cast<std::size_t>(record.bytes));
  PALPATE_TRY(file.read_at(record.at, content));
  if (text) {
    found.text.assign(reinterpret_cast<const char*>(content.data()), content.size());
    found.text.resize(std::min(found.text.size(), found.text.find('\0')));
  } else if (keys) {
    found.keys = std::move(content);
  } else {
    found.compression = std::move(content);
    found.compression_at = record.at;
  }
  return Done{};
}

// Walks `count` records between two places; `extended`: those at the file's end, with 64-bit lengths.
Status walk_las_records(const RandomAccess& file, std::uint64_t at, std::uint64_t end, std::uint64_t count,
                        bool extended, LasRecords& found, LasHeader& header) {
  const std::size_t head_bytes = extended ? kEvlrBytes : kVlrBytes;
  for (std::uint64_t i = 0; i < count; ++i) {
    std::array<std::byte, kEvlrBytes> bytes{};
    const std::span<std::byte> head = std::span(bytes).first(head_bytes);
    std::uint64_t length = std::numeric_limits<std::uint64_t>::max();
    LasRecord record;
    if (at <= end && head_bytes <= end - at) {
      PALPATE_TRY(file.read_at(at, head));
      ByteReader in(head);
      (void)in.u16();
      const std::span<const std::byte> user = in.raw(kUserBytes);
      record.user = {reinterpret_cast<const char*>(user.data()), user.size()};
      record.user = record.user.substr(0, record.user.find('\0'));
      record.number = in.u16();
      length = extended ? in.u64() : in.u16();
      record.at = at + head_bytes;
    }
    if (length > end - std::min(record.at, end) || record.at == 0) {
      header.warnings.push_back(
          fmt::format("The header promises {} {}records, of which number {} at byte {} passes their end at "
                      "byte {}: it and "
                      "what follows it were left out.",
                      count, extended ? "extended " : "", i + 1, at, end));
      return Done{};
    }
    record.bytes = length;
    PALPATE_TRY(take_las_record(file, record, found));
    at = record.at + length;
  }
  return Done{};
}

// Counts and places of the header, before they are compared with each other.
struct LasCounts {
  std::uint16_t encoding = 0;
  std::uint8_t minor = 0;
  std::uint16_t header_bytes = 0;
  std::uint32_t records = 0;
  bool compressed = false;
  std::uint64_t extended_at = 0;
  std::uint32_t extended = 0;
};

Result<LasCounts> read_las_counts(std::span<const std::byte> bytes, LasHeader& header) {
  LasCounts counts;
  counts.encoding = ByteReader(bytes.subspan(kEncodingAt)).u16();
  ByteReader version(bytes.subspan(kVersionAt));
  const std::uint8_t major = version.u8();
  counts.minor = version.u8();
  if (major != 1 || counts.minor > kLastMinorVersion)
    return Error{fmt::format("LAS version {}.{} (at byte {}) is not read, only 1.0 to 1.{}", major,
                             counts.minor, kVersionAt, kLastMinorVersion),
                 "save it as LAS 1.4: pdal translate in.las out.las --writers.las.minor_version=4"};
  ByteReader sizes(bytes.subspan(kSizesAt));
  counts.header_bytes = sizes.u16();
  header.points_at = sizes.u32();
  counts.records = sizes.u32();
  const std::uint8_t format = sizes.u8();
  header.point_bytes = sizes.u16();
  header.points = sizes.u32();
  const std::size_t least = counts.minor >= 4   ? kHeader14Bytes
                            : counts.minor == 3 ? kHeader13Bytes
                                                : kHeader10Bytes;
  if (counts.header_bytes < least || bytes.size() < least)
    return Error{
        fmt::format("the header has {} bytes (says byte {}) of a file of at least {}, LAS 1.{} needs {}",
                    counts.header_bytes, kSizesAt, bytes.size(), counts.minor, least),
        kDamagedHeaderRemedy};
  counts.compressed = (format & ~kFormatMask) != 0;
  header.point_format = format & kFormatMask;
  if ((counts.compressed && (format & kCompressedFlag) == 0) || header.point_format >= std::size(kLasFormats))
    return Error{fmt::format("the point format {} (at byte {}) is not read, only 0 to {}", format,
                             kSizesAt + 10, std::size(kLasFormats) - 1),
                 "save it as LAS 1.4: pdal translate in.las out.las --writers.las.minor_version=4"};
  const LasFormatRow& row = kLasFormats[header.point_format];
  header.colour_at = row.colour_at;
  if (header.point_bytes < row.bytes)
    return Error{fmt::format("a point has {} bytes (says byte {}), point format {} needs {}",
                             header.point_bytes, kSizesAt + 11, header.point_format, row.bytes),
                 kDamagedHeaderRemedy};
  if (counts.minor >= 4) {
    ByteReader extended(bytes.subspan(kEvlrsAt));
    counts.extended_at = extended.u64();
    counts.extended = extended.u32();
    const std::uint64_t points = extended.u64();
    if (points != 0) header.points = points;
  }
  return counts;
}

Status read_las_lattice(std::span<const std::byte> bytes, LasHeader& header) {
  ByteReader in(bytes.subspan(kScalesAt));
  header.scale = in.vec();
  header.offset = in.vec();
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t at = kScalesAt + sizeof(double) * static_cast<std::size_t>(axis);
    if (!std::isfinite(header.scale[axis]) || header.scale[axis] == 0.0 ||
        !std::isfinite(header.offset[axis]))
      return Error{fmt::format("the scale {} at byte {} or the offset {} at byte {} is no length",
                               header.scale[axis], at, header.offset[axis], at + 3 * sizeof(double)),
                   kDamagedHeaderRemedy};
  }
  geometry::Aabb bounds;
  for (int axis = 0; axis < 3; ++axis) {
    bounds.high_mm[axis] = in.real();
    bounds.low_mm[axis] = in.real();
  }
  if (bounds.low_mm.allFinite() && bounds.high_mm.allFinite() &&
      (bounds.low_mm.array() <= bounds.high_mm.array()).all())
    header.bounds = bounds;
  return Done{};
}

}  // namespace

Result<LasHeader> read_las_header(const RandomAccess& file) {
  std::array<std::byte, kHeader14Bytes> storage{};
  const std::span<std::byte> bytes = std::span(storage).first(
      static_cast<std::size_t>(std::min<std::uint64_t>(file.size(), storage.size())));
  PALPATE_TRY(file.read_at(0, bytes));
  if (bytes.size() < std::strlen(kLasMagic) ||
      std::memcmp(bytes.data(), kLasMagic, std::strlen(kLasMagic)) != 0)
    return Error{"the file does not begin with LASF: it is no LAS file", "check the file"};
  if (bytes.size() < kHeader10Bytes)
    return Error{fmt::format("the file ends within its header, at byte {}", bytes.size()), kLasIsCut};
  LasHeader header;
  PALPATE_ASSIGN(const LasCounts counts, read_las_counts(bytes, header));
  PALPATE_TRY(read_las_lattice(bytes, header));
  if (header.points_at < counts.header_bytes || header.points_at > file.size())
    return Error{
        fmt::format("the points should begin at byte {} (says byte {}), the header ends at {} and the "
                    "file at {}",
                    header.points_at, kSizesAt + 2, counts.header_bytes, file.size()),
        header.points_at > file.size() ? kLasIsCut : kDamagedHeaderRemedy};
  LasRecords found;
  PALPATE_TRY(
      walk_las_records(file, counts.header_bytes, header.points_at, counts.records, false, found, header));
  if (counts.extended > 0)
    PALPATE_TRY(walk_las_records(file, std::max(counts.extended_at, header.points_at), file.size(),
                                 counts.extended, true, found, header));
  if (counts.compressed) {
    if (found.compression_at == 0)
      return Error{
          fmt::format("the points are compressed (says byte {}), but no record says how", kSizesAt + 10),
          kDamagedHeaderRemedy};
    PALPATE_ASSIGN(header.compression,
                   laz::read_compression(found.compression, found.compression_at, header.point_bytes,
                                         header.point_format >= kFirstLayeredFormat));
  }
  header.format = fmt::format("{} 1.{}, point format {}",
                              !counts.compressed ? "LAS"
                              : found.copc       ? "COPC, LAZ"
                                                 : "LAZ",
                              counts.minor, header.point_format);
  header.unit = unit_of_las(found.keys, found.text, (counts.encoding & kTextFlag) != 0);
  header.warnings.insert(header.warnings.end(), header.unit.warnings.begin(), header.unit.warnings.end());
  return header;
}

}  // namespace palpate::io
