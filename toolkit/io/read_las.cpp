#include "toolkit/io/read_las.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "toolkit/core/bytes.h"
#include "toolkit/io/las_header.h"
#include "toolkit/io/las_points.h"

namespace palpate::io {
namespace {

constexpr std::array<const char*, 4> kPropertyNames{"intensity", "red", "green", "blue"};

Vec3 position_of(std::span<const std::byte> point, const LasHeader& header) noexcept {
  ByteReader in(point);
  const double x = in.i32(), y = in.i32(), z = in.i32();
  return header.offset + Vec3(x, y, z).cwiseProduct(header.scale);
}

// Takes points of a piece into a DecodedFile.
void take_points(std::span<const std::byte> piece, const LasHeader& header, DecodedFile& decoded) {
  for (; !piece.empty(); piece = piece.subspan(header.point_bytes)) {
    const std::span<const std::byte> point = piece.first(header.point_bytes);
    decoded.points.push_back(position_of(point, header));
    decoded.properties[0].values.push_back(ByteReader(point.subspan(kLasIntensityAt)).u16());
    ByteReader colours(point.subspan(header.colour_at));
    for (std::size_t i = 1; i < decoded.properties.size(); ++i)
      decoded.properties[i].values.push_back(colours.u16());
  }
}

Result<DecodedFile> decode_las(const RandomAccess& file, const ReadOptions& options, Progress& progress) {
  PALPATE_ASSIGN(const LasHeader header, read_las_header(file));
  DecodedFile decoded;
  decoded.format = header.format;
  decoded.unit = header.unit.unit;
  decoded.conventional_unit = header.unit.conventional_unit;
  decoded.warnings = header.warnings;
  const std::size_t properties = header.colour_at > 0 ? kPropertyNames.size() : 1;
  for (std::size_t i = 0; i < properties; ++i) decoded.properties.push_back({kPropertyNames[i], {}});

  PALPATE_ASSIGN(LasPoints points, LasPoints::open(file, header, 0));
  PALPATE_TRY(check_memory(points.points(), sizeof(Vec3) + properties * sizeof(float), "points", options));
  // LAZ promises points that may not be there.
  constexpr std::uint64_t kReservedUnseen = std::uint64_t{1} << 20;
  const auto reserved = static_cast<std::size_t>(
      header.compression ? std::min(points.points(), kReservedUnseen) : points.points());
  decoded.points.reserve(reserved);
  for (cloud::Property& property : decoded.properties) property.values.reserve(reserved);
  while (true) {
    PALPATE_ASSIGN(const std::span<const std::byte> piece, points.next());
    if (piece.empty()) break;
    take_points(piece, header, decoded);
    progress.report("reading",
                    static_cast<double>(points.points_given()) / static_cast<double>(points.points()));
    if (progress.cancelled()) return Error{"reading was stopped"};
  }
  return decoded;
}

class LasStream final : public PointStream {
 public:
  LasStream(std::unique_ptr<RandomAccess> file, LasHeader las, std::string name)
      : file_(std::move(file)), las_(std::move(las)), name_(std::move(name)) {
    header_.format = las_.format;
    header_.unit = las_.unit.unit;
    header_.conventional_unit = las_.unit.conventional_unit;
    header_.bounds = las_.bounds;
    header_.warnings = las_.warnings;
  }

  // Apart from the constructor: it may fail, and keeps addresses of this object's parts.
  Status open_points(int threads) {
    Result<LasPoints> points = LasPoints::open(*file_, las_, threads);
    if (!points) return std::move(points).error().in_file(name_);
    points_ = std::move(*points);
    header_.points = points_->points();
    return Done{};
  }

  [[nodiscard]] const StreamHeader& header() const noexcept override { return header_; }

  Result<std::size_t> read(std::span<Vec3> out) override {
    std::size_t written = 0;
    while (written < out.size()) {
      if (piece_.empty()) {
        if (error_) break;
        Result<std::span<const std::byte>> next = points_->next();
        if (!next) {
          error_ = std::move(next).error().in_file(name_);
          break;
        }
        piece_ = *next;
        if (piece_.empty()) break;
      }
      const std::size_t points = std::min(out.size() - written, piece_.size() / las_.point_bytes);
      for (std::size_t i = 0; i < points; ++i)
        out[written + i] = position_of(piece_.subspan(i * las_.point_bytes), las_);
      written += points;
      piece_ = piece_.subspan(points * las_.point_bytes);
    }
    if (written == 0 && error_ && !out.empty()) return *error_;
    return written;
  }

  Status rewind() override {
    points_->rewind();
    piece_ = {};
    error_.reset();
    return Done{};
  }

 private:
  std::unique_ptr<RandomAccess> file_;
  LasHeader las_;
  std::string name_;
  StreamHeader header_;
  std::optional<LasPoints> points_;
  std::span<const std::byte> piece_;
  std::optional<Error> error_;  ///< behind the points that were given
};

}  // namespace

Result<DecodedFile> read_las(const RandomAccess& file, const std::string& name, const ReadOptions& options,
                             Progress& progress) {
  Result<DecodedFile> decoded = decode_las(file, options, progress);
  if (!decoded) return std::move(decoded).error().in_file(name);
  return decoded;
}

Result<DecodedFile> read_las_bytes(const ReaderInput& input) {
  PALPATE_ASSIGN(const std::vector<std::byte> bytes, read_all(input.bytes, input.options.max_bytes));
  return read_las(MemoryAccess(bytes), input.name, input.options, input.progress);
}

Result<std::unique_ptr<PointStream>> las_stream(std::unique_ptr<RandomAccess> file, const std::string& name,
                                                int threads) {
  Result<LasHeader> header = read_las_header(*file);
  if (!header) return std::move(header).error().in_file(name);
  auto stream = std::make_unique<LasStream>(std::move(file), std::move(*header), name);
  PALPATE_TRY(stream->open_points(threads));
  return std::unique_ptr<PointStream>(std::move(stream));
}

}  // namespace palpate::io
