#include "toolkit/io/point_stream.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "toolkit/io/decoding.h"
#include "toolkit/io/las_header.h"
#include "toolkit/io/pcd_header.h"
#include "toolkit/io/ply_header.h"
#include "toolkit/io/read_e57.h"
#include "toolkit/io/read_las.h"
#include "toolkit/io/read_ptx.h"

namespace palpate::io {
namespace {

constexpr std::string_view kStreamedFormats = "LAS, LAZ, COPC, E57, PTX, PTS, binary PLY and binary PCD";
constexpr const char* kBinaryPlyRemedy = "convert it: pdal translate in.ply out.las";
constexpr const char* kBinaryPcdRemedy = "convert it: pcl_convert_pcd_ascii_binary in.pcd out.pcd 1";
// The formats differ in the first line or two; a row of PTS has up to 70 characters.
constexpr std::size_t kFirstBytes = 4096;
// A PCD header with 256 fields of long names stays below this.
constexpr std::size_t kPcdFirstBytes = std::size_t{1} << 16;
// Bytes of rows that are held at once.
constexpr std::uint64_t kRowPieceBytes = std::uint64_t{4} << 20;

// Rows of equal length in a file, of which three numbers are a position.
struct RowLayout {
  std::uint64_t at = 0;  // of the first row
  std::uint64_t row_bytes = 0;
  std::array<std::size_t, 3> offsets{};  // of x, y and z in a row
  std::array<PlyScalar, 3> types{};
  bool swap = false;  // the other order of bytes than this machine's
};

class RowStream final : public PointStream {
 public:
  RowStream(std::unique_ptr<RandomAccess> file, std::string name, StreamHeader header, RowLayout layout)
      : file_(std::move(file)), name_(std::move(name)), header_(std::move(header)), layout_(layout) {}

  [[nodiscard]] const StreamHeader& header() const noexcept override { return header_; }

  Result<std::size_t> read(std::span<Vec3> out) override {
    std::size_t written = 0;
    while (written < out.size() && next_ < header_.points) {
      const std::uint64_t most = std::max<std::uint64_t>(1, kRowPieceBytes / layout_.row_bytes);
      const std::uint64_t rows =
          std::min({most, header_.points - next_, std::uint64_t{out.size() - written}});
      piece_.resize(static_cast<std::size_t>(rows * layout_.row_bytes));
      if (Status read = file_->read_at(layout_.at + next_ * layout_.row_bytes, piece_); !read) {
        if (written > 0) break;
        return std::move(read).error().in_file(name_);
      }
      for (std::uint64_t row = 0; row < rows; ++row) {
        const std::byte* const begin = piece_.data() + row * layout_.row_bytes;
        Vec3& point = out[written++];
        for (std::size_t axis = 0; axis < 3; ++axis)
          point[static_cast<Eigen::Index>(axis)] =
              ply_value(layout_.types[axis], begin + layout_.offsets[axis], layout_.swap);
      }
      next_ += rows;
    }
    return written;
  }

  Status rewind() override {
    next_ = 0;
    return Done{};
  }

 private:
  std::unique_ptr<RandomAccess> file_;
  std::string name_;
  StreamHeader header_;
  RowLayout layout_;
  std::uint64_t next_ = 0;
  std::vector<std::byte> piece_;
};

// The axis that a name means, or -1.
int axis_of(std::string_view name) noexcept {
  constexpr std::string_view kAxisNames = "xyz";
  return name.size() == 1 ? static_cast<int>(static_cast<std::int64_t>(kAxisNames.find(name[0]))) : -1;
}

Result<std::unique_ptr<PointStream>> ply_stream(std::unique_ptr<RandomAccess> file, const std::string& path) {
  PALPATE_ASSIGN(const std::unique_ptr<ByteSource> bytes, open_file(path));
  BufferedInput in(*bytes);
  PALPATE_ASSIGN(const PlyHeader ply, read_ply_header(in));
  if (ply.format == PlyFormat::kAscii)
    return Error{"points in pieces are read of binary PLY files only, and this one is text",
                 kBinaryPlyRemedy};
  RowLayout layout;
  layout.at = file->size() - in.remaining().value_or(0);
  layout.swap = (ply.format == PlyFormat::kBigEndian) != (std::endian::native == std::endian::big);
  for (const PlyElement& element : ply.elements) {
    if (element.has_lists())
      return Error{
          fmt::format("the element {} has lists and stands before the points, or is the points: their "
                      "places cannot be told",
                      shown(element.name)),
          kBinaryPlyRemedy};
    layout.row_bytes = element.min_row_bytes(false);
    if (element.name != "vertex") {
      layout.at += element.count * layout.row_bytes;
      continue;
    }
    std::size_t offset = 0;
    int axes = 0;
    for (const PlyProperty& property : element.properties) {
      if (const int axis = axis_of(property.name); axis >= 0) {
        layout.offsets[static_cast<std::size_t>(axis)] = offset;
        layout.types[static_cast<std::size_t>(axis)] = property.type;
        ++axes;
      }
      offset += ply_bytes(property.type);
    }
    if (axes != 3)
      return Error{"the element 'vertex' has no scalar properties x, y and z", "check the header"};
    StreamHeader header;
    header.format = format_name(ply.format);
    header.points = element.count;
    header.unit = ply.unit;
    return std::unique_ptr<PointStream>(
        std::make_unique<RowStream>(std::move(file), path, std::move(header), layout));
  }
  return Error{"the PLY file has no element 'vertex'", "check that it holds points"};
}

std::optional<PlyScalar> scalar_of(const PcdField& field) noexcept {
  const bool is_signed = field.type == 'I';
  if (field.type == 'F') return field.bytes == sizeof(float) ? PlyScalar::kFloat32 : PlyScalar::kFloat64;
  if (field.bytes == 1) return is_signed ? PlyScalar::kInt8 : PlyScalar::kUint8;
  if (field.bytes == 2) return is_signed ? PlyScalar::kInt16 : PlyScalar::kUint16;
  if (field.bytes == 4) return is_signed ? PlyScalar::kInt32 : PlyScalar::kUint32;
  return std::nullopt;
}

Result<std::unique_ptr<PointStream>> pcd_stream(std::unique_ptr<RandomAccess> file, const std::string& path) {
  std::vector<std::byte> first(
      static_cast<std::size_t>(std::min<std::uint64_t>(file->size(), kPcdFirstBytes)));
  PALPATE_TRY(file->read_at(0, first));
  PALPATE_ASSIGN(const PcdHeader pcd, parse_pcd_header(first));
  if (pcd.data != PcdData::kBinary)
    return Error{fmt::format("points in pieces are read of binary PCD files only, and this one is {}",
                             pcd.data == PcdData::kAscii ? "text" : "compressed"),
                 kBinaryPcdRemedy};
  const std::uint64_t room = (file->size() - pcd.body_at) / pcd.point_bytes;
  if (room < pcd.points())
    return Error{fmt::format("the header promises {} points, but the file ends at byte {} after {}",
                             pcd.points(), file->size(), room),
                 "the file is cut off or its header is wrong: fetch it again"};
  RowLayout layout;
  layout.at = pcd.body_at;
  layout.row_bytes = pcd.point_bytes;
  layout.swap = std::endian::native == std::endian::big;
  std::size_t offset = 0;
  for (const PcdField& field : pcd.fields) {
    if (const int axis = axis_of(field.name); axis >= 0) {
      const std::optional<PlyScalar> type = scalar_of(field);
      if (!type)
        return Error{fmt::format("the field {} holds whole numbers of 64 bits, which are no coordinates",
                                 shown(field.name)),
                     "save the file with coordinates as float or double"};
      layout.offsets[static_cast<std::size_t>(axis)] = offset;
      layout.types[static_cast<std::size_t>(axis)] = *type;
    }
    offset += std::size_t{field.bytes} * field.count;
  }
  StreamHeader header;
  header.format = "PCD, binary";
  header.points = pcd.points();
  header.conventional_unit = Unit::kMetre;
  return std::unique_ptr<PointStream>(
      std::make_unique<RowStream>(std::move(file), path, std::move(header), layout));
}

enum class StreamFormat { kUnknown, kCompressed, kLas, kE57, kPly, kPcd, kPtx, kPts };

StreamFormat format_of(std::string_view first) {
  if (detect_compression(std::as_bytes(std::span(first))) != Compression::kNone)
    return StreamFormat::kCompressed;
  if (first.starts_with(kLasMagic)) return StreamFormat::kLas;
  if (first.starts_with("ASTM-E57")) return StreamFormat::kE57;
  if (first.starts_with("ply\n") || first.starts_with("ply\r")) return StreamFormat::kPly;
  for (const std::string_view word : {"# .PCD", "VERSION", "FIELDS", "COLUMNS"})
    if (first.starts_with(word)) return StreamFormat::kPcd;
  if (starts_as_ptx(first)) return StreamFormat::kPtx;
  return starts_as_pts(first) ? StreamFormat::kPts : StreamFormat::kUnknown;
}

/// Streams one after another.
class JoinedStream final : public PointStream {
 public:
  JoinedStream(std::vector<std::unique_ptr<PointStream>> parts, StreamHeader header)
      : parts_(std::move(parts)), header_(std::move(header)) {}
  const StreamHeader& header() const noexcept override { return header_; }
  Result<std::size_t> read(std::span<Vec3> out) override {
    for (; at_ < parts_.size() && !out.empty(); ++at_) {
      PALPATE_ASSIGN(const std::size_t got, parts_[at_]->read(out));
      if (got > 0) return got;
    }
    return std::size_t{0};
  }
  Status rewind() override {
    at_ = 0;
    for (const std::unique_ptr<PointStream>& part : parts_) PALPATE_TRY(part->rewind());
    return Done{};
  }

 private:
  std::vector<std::unique_ptr<PointStream>> parts_;
  StreamHeader header_;
  std::size_t at_ = 0;
};

/// Adds a part's facts to those of the parts before it.
Status join(const StreamHeader& part, StreamHeader& all) {
  if (part.unit != all.unit || part.conventional_unit != all.conventional_unit)
    return Error{"its unit is not that of the folder's first file", "give files of one unit"};
  all.points += part.points;
  if (all.bounds && part.bounds) {
    all.bounds->add(part.bounds->low_mm);
    all.bounds->add(part.bounds->high_mm);
  } else {
    all.bounds.reset();
  }
  all.warnings.insert(all.warnings.end(), part.warnings.begin(), part.warnings.end());
  return Done{};
}

Result<std::unique_ptr<PointStream>> open_stream(const std::string& path, int threads) {
  PALPATE_ASSIGN(std::unique_ptr<RandomAccess> file, open_random_access(path));
  std::string first(static_cast<std::size_t>(std::min<std::uint64_t>(file->size(), kFirstBytes)), '\0');
  if (first.empty()) return Error{"the file is empty", "check the file"};
  PALPATE_TRY(file->read_at(0, std::as_writable_bytes(std::span(first))));
  switch (format_of(first)) {
    case StreamFormat::kLas:
      return las_stream(std::move(file), path, threads);
    case StreamFormat::kE57:
      return e57_stream(std::move(file), path);
    case StreamFormat::kPtx:
      return ptx_stream(std::move(file), path);
    case StreamFormat::kPts:
      return pts_stream(std::move(file), path);
    case StreamFormat::kPly:
      return ply_stream(std::move(file), path);
    case StreamFormat::kPcd:
      return pcd_stream(std::move(file), path);
    case StreamFormat::kCompressed:
      return Error{"points in pieces are not read of a file compressed by gzip or xz",
                   "decompress it first: gunzip file.gz, or xz -d file.xz"};
    case StreamFormat::kUnknown:
      break;
  }
  return Error{"the file's first bytes are those of no format that is read in pieces",
               fmt::format("convert it to one of {}", kStreamedFormats)};
}

}  // namespace

Result<std::unique_ptr<PointStream>> open_point_stream(const std::string& path, int threads) {
  Result<std::unique_ptr<PointStream>> stream = open_stream(path, threads);
  if (!stream) return std::move(stream).error().in_file(path);
  return stream;
}

Result<std::vector<std::string>> files_of_folder(const std::string& folder) {
  std::error_code failed;
  std::vector<std::string> paths;
  for (const auto& entry : std::filesystem::directory_iterator(folder, failed))
    if (entry.is_regular_file(failed)) paths.push_back(entry.path().string());
  if (failed)
    return Error{fmt::format("cannot list the folder: {}", failed.message()), "check the path", folder};
  if (paths.empty()) return Error{"the folder has no files", "give a folder of a scan's tiles", folder};
  std::sort(paths.begin(), paths.end());
  return paths;
}

Result<std::unique_ptr<PointStream>> open_folder_stream(const std::string& folder, int threads) {
  PALPATE_ASSIGN(const std::vector<std::string> paths, files_of_folder(folder));
  std::vector<std::unique_ptr<PointStream>> parts;
  StreamHeader header;
  for (const std::string& path : paths) {
    PALPATE_ASSIGN(std::unique_ptr<PointStream> part, open_point_stream(path, threads));
    if (parts.empty())
      header = part->header();
    else if (const Status joined = join(part->header(), header); !joined)
      return Error(joined.error()).in_file(path);
    parts.push_back(std::move(part));
  }
  header.format = fmt::format("{} files, {}", parts.size(), header.format);
  return std::unique_ptr<PointStream>(std::make_unique<JoinedStream>(std::move(parts), std::move(header)));
}

}  // namespace palpate::io
