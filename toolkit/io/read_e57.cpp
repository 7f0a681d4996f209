#include "toolkit/io/read_e57.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace palpate::io {
namespace {

// Records at a time: enough that a call costs nothing beside them, and some 100 KB.
constexpr std::size_t kRecordsOfBatch = 4096;

constexpr std::array<std::string_view, 3> kCartesian{"cartesianX", "cartesianY", "cartesianZ"};
constexpr std::array<std::string_view, 3> kSpherical{"sphericalRange", "sphericalAzimuth",
                                                     "sphericalElevation"};
constexpr std::string_view kCartesianInvalid = "cartesianInvalidState",
                           kSphericalInvalid = "sphericalInvalidState";

bool has_all(const E57Scan& scan, const std::array<std::string_view, 3>& fields) {
  return std::all_of(fields.begin(), fields.end(),
                     [&](std::string_view field) { return scan.find(field).has_value(); });
}

// Fields that are read must be numbers.
Status check_fields(const E57Scan& scan) {
  if (!has_all(scan, kCartesian) && !has_all(scan, kSpherical))
    return Error{fmt::format("{} has neither cartesian nor spherical coordinates", scan.name),
                 "export the file again with cartesianX, cartesianY and cartesianZ"};
  for (const E57Field& field : scan.fields) {
    if (field.type != E57Type::kText) continue;
    const auto named = [&](std::string_view name) { return name == field.name; };
    bool read = std::any_of(kCartesian.begin(), kCartesian.end(), named) ||
                std::any_of(kSpherical.begin(), kSpherical.end(), named) || named(kCartesianInvalid) ||
                named(kSphericalInvalid);
    for (const E57Property& property : kE57Properties)
      read = read || named(property.field) || named(property.invalid);
    if (read)
      return Error{fmt::format("the field '{}' of {} holds text instead of numbers", field.name, scan.name),
                   "export the file again with numbers"};
  }
  return Done{};
}

// From the sphere about the scanner: azimuth from +x to +y, elevation from the xy plane to +z.
Vec3 from_sphere(double range, double azimuth, double elevation) noexcept {
  const double across = range * std::cos(elevation);
  return {across * std::cos(azimuth), across * std::sin(azimuth), range * std::sin(elevation)};
}

std::string e57_format(const E57Reader& reader) {
  const std::size_t scans = reader.scans().size();
  return fmt::format("E57 1.0, {} scan{}", scans, scans == 1 ? "" : "s");
}

class E57Stream final : public PointStream {
 public:
  E57Stream(std::unique_ptr<RandomAccess> file, std::string name, E57Reader reader)
      : file_(std::move(file)), name_(std::move(name)), reader_(std::move(reader)) {
    header_.format = e57_format(reader_);
    header_.points = reader_.records();
    header_.unit = Unit::kMetre;
    geometry::Aabb bounds;
    bool stated = reader_.records() > 0;
    for (const E57Scan& scan : reader_.scans()) {
      if (scan.records == 0) continue;
      stated = stated && scan.bounds;
      if (stated) bounds.add(*scan.bounds);
    }
    if (stated) header_.bounds = bounds;
  }

  const StreamHeader& header() const noexcept override { return header_; }
  Result<std::size_t> read(std::span<Vec3> out) override {
    std::size_t written = 0;
    while (written < out.size()) {
      if (given_ == reader_.points().size()) {
        given_ = 0;
        Result<bool> more = reader_.next();
        if (!more) return std::move(more).error().in_file(name_);
        if (!*more) break;
      }
      const std::size_t n = std::min(out.size() - written, reader_.points().size() - given_);
      std::copy_n(reader_.points().begin() + static_cast<std::ptrdiff_t>(given_), n,
                  out.begin() + static_cast<std::ptrdiff_t>(written));
      written += n;
      given_ += n;
    }
    return written;
  }
  Status rewind() override {
    given_ = 0;
    Status begun = reader_.rewind();
    if (!begun) return std::move(begun).error().in_file(name_);
    return begun;
  }

 private:
  std::unique_ptr<RandomAccess> file_;
  std::string name_;
  E57Reader reader_;
  StreamHeader header_;
  std::size_t given_ = 0;  // of the reader's points
};

}  // namespace

Result<E57Reader> E57Reader::open(const RandomAccess& file, bool with_properties) {
  PALPATE_ASSIGN(E57Pages pages, E57Pages::open(file));
  if (pages.xml_bytes() > kMaxE57XmlBytes)
    return over_memory_limit(fmt::format("the E57 file's XML of {} bytes", pages.xml_bytes()),
                             kMaxE57XmlBytes);
  std::string xml(static_cast<std::size_t>(pages.xml_bytes()), '\0');
  PALPATE_TRY(pages.read(pages.xml_at(), std::as_writable_bytes(std::span(xml))));
  E57Reader reader(std::move(pages), with_properties);
  PALPATE_ASSIGN(std::vector<E57Scan> scans, parse_e57_scans(xml));
  reader.scans_ = std::make_unique<std::vector<E57Scan>>(std::move(scans));
  for (const E57Scan& scan : reader.scans()) {
    // The sections say first whether the counts may be believed.
    PALPATE_TRY(E57Records::open(*reader.pages_, scan, {}));
    PALPATE_TRY(check_fields(scan));
    reader.records_ += scan.records;
    for (std::size_t p = 0; p < kE57Properties.size(); ++p)
      reader.has_[p] = reader.has_[p] || scan.find(kE57Properties[p].field).has_value();
  }
  PALPATE_TRY(reader.rewind());
  return reader;
}

Status E57Reader::rewind() {
  left_out_ = 0;
  points_.clear();
  return open_scan(0);
}

// The column of a field, which is read from now on; nothing where the scan has none.
std::optional<std::size_t> E57Reader::want(std::string_view field) {
  const std::optional<std::size_t> index = scans()[scan_].find(field);
  if (!index) return std::nullopt;
  const auto known = std::find(wanted_.begin(), wanted_.end(), *index);
  if (known != wanted_.end()) return static_cast<std::size_t>(known - wanted_.begin());
  wanted_.push_back(*index);
  return wanted_.size() - 1;
}

Status E57Reader::open_scan(std::size_t index) {
  scan_ = index;
  present_.reset();
  if (scan_ >= scans().size()) return Done{};
  wanted_.clear();
  const E57Scan& scan = scans()[scan_];
  spherical_ = !has_all(scan, kCartesian);
  const std::array<std::string_view, 3>& axes = spherical_ ? kSpherical : kCartesian;
  for (std::size_t a = 0; a < axes.size(); ++a) position_[a] = want(axes[a]).value_or(0);  // are there
  invalid_ = want(spherical_ ? kSphericalInvalid : kCartesianInvalid);
  for (std::size_t p = 0; p < kE57Properties.size() && with_properties_; ++p) {
    property_[p] = want(kE57Properties[p].field);
    property_invalid_[p] = property_[p] ? want(kE57Properties[p].invalid) : std::nullopt;
  }
  columns_.resize(wanted_.size());
  PALPATE_ASSIGN(present_, E57Records::open(*pages_, scan, wanted_));
  return Done{};
}

Result<bool> E57Reader::next() {
  points_.clear();
  for (std::vector<float>& values : values_) values.clear();
  while (present_ && present_->left() == 0) PALPATE_TRY(open_scan(scan_ + 1));
  if (!present_) return false;
  PALPATE_ASSIGN(const std::size_t count, present_->next(kRecordsOfBatch, columns_));
  place(scans()[scan_], count);
  return true;
}

void E57Reader::place(const E57Scan& scan, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    if (invalid_ && columns_[*invalid_][i] != 0.0) {
      ++left_out_;
      continue;
    }
    const Vec3 read(columns_[position_[0]][i], columns_[position_[1]][i], columns_[position_[2]][i]);
    const Vec3 local = spherical_ ? from_sphere(read.x(), read.y(), read.z()) : read;
    points_.push_back(scan.rotation * local + scan.translation);
    for (std::size_t p = 0; p < kE57Properties.size() && with_properties_; ++p) {
      const bool missing =
          !property_[p] || (property_invalid_[p] && columns_[*property_invalid_[p]][i] != 0.0);
      values_[p].push_back(missing ? std::numeric_limits<float>::quiet_NaN()
                                   : to_float(columns_[*property_[p]][i]));
    }
  }
}

Result<std::unique_ptr<PointStream>> e57_stream(std::unique_ptr<RandomAccess> file, const std::string& name) {
  Result<E57Reader> reader = E57Reader::open(*file, false);
  if (!reader) return std::move(reader).error().in_file(name);
  return std::unique_ptr<PointStream>(std::make_unique<E57Stream>(std::move(file), name, std::move(*reader)));
}

Result<DecodedFile> read_e57(const ReaderInput& input) {
  PALPATE_ASSIGN(const std::vector<std::byte> bytes, read_all(input.bytes, input.options.max_bytes));
  const MemoryAccess file(bytes);
  PALPATE_ASSIGN(E57Reader reader, E57Reader::open(file, true));
  DecodedFile decoded;
  decoded.format = e57_format(reader);
  decoded.unit = Unit::kMetre;
  std::array<std::size_t, kE57Properties.size()> kept{};
  for (std::size_t p = 0; p < kE57Properties.size(); ++p) {
    if (!reader.has(p)) continue;
    kept[p] = decoded.properties.size();
    decoded.properties.push_back({std::string(kE57Properties[p].name), {}});
  }
  PALPATE_TRY(check_memory(reader.records(), sizeof(Vec3) + decoded.properties.size() * sizeof(float),
                           "records", input.options));
  constexpr std::uint64_t kRecordBytes = 1;  // a record of one bit has less, and is rare
  const std::size_t reserve = reserve_count(reader.records(), kRecordBytes, bytes.size());
  decoded.points.reserve(reserve);
  for (cloud::Property& property : decoded.properties) property.values.reserve(reserve);

  std::uint64_t reported = 0;
  while (true) {
    PALPATE_ASSIGN(const bool more, reader.next());
    if (!more) break;
    decoded.points.insert(decoded.points.end(), reader.points().begin(), reader.points().end());
    for (std::size_t p = 0; p < kE57Properties.size(); ++p) {
      if (!reader.has(p)) continue;
      std::vector<float>& values = decoded.properties[kept[p]].values;
      values.insert(values.end(), reader.values()[p].begin(), reader.values()[p].end());
    }
    const std::uint64_t done = decoded.points.size() + reader.left_out();
    if (done < reported + kRowsPerReport) continue;
    reported = done;
    input.progress.report("reading", static_cast<double>(done) / static_cast<double>(reader.records()));
    if (input.progress.cancelled()) return Error{"reading was stopped"};
  }
  if (reader.left_out() > 0)
    decoded.warnings.push_back(fmt::format("{} of the file's {} records are marked as invalid: holes.",
                                           reader.left_out(), reader.records()));
  return decoded;
}

}  // namespace palpate::io
