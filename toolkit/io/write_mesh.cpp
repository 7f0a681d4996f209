#include <palpate/read_model.h>

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <limits>
#include <span>
#include <string_view>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/bytes.h"
#include "toolkit/core/files.h"
#include "toolkit/io/decoding.h"

namespace palpate::io {
namespace {

// Collects rows and hands them to the file in large blocks.
class RowWriter {
 public:
  explicit RowWriter(AtomicFile& file) : file_(file) { buffer_.reserve(kBlock); }

  void u8(std::uint8_t value) { add(sizeof value).u8(value); }
  void u32(std::uint32_t value) { add(sizeof value).u32(value); }
  void single(float value) { add(sizeof value).single(value); }
  void point(const Vec3& p) { add(3 * sizeof(double)).vec(p); }
  Status end_row() { return buffer_.size() < kBlock ? Status(Done{}) : flush(); }
  Status flush() {
    Status written = file_.write(buffer_);
    buffer_.clear();
    return written;
  }

 private:
  ByteWriter add(std::size_t bytes) { return append_to(buffer_, bytes); }

  static constexpr std::size_t kBlock = std::size_t{1} << 16;
  AtomicFile& file_;
  std::vector<std::byte> buffer_;
};

constexpr std::string_view kMark = "written by palpate";
constexpr std::string_view kStart =
    "ply\nformat binary_little_endian 1.0\ncomment written by palpate\ncomment unit mm\n";
constexpr std::string_view kPosition = "property double x\nproperty double y\nproperty double z\n";

// PLY and text separate words by blanks or commas, so a name must be one word.
std::string one_word(const std::string& name) {
  std::string word = name.empty() ? std::string("unnamed") : name;
  for (char& c : word) {
    if (c <= ' ' || c == 0x7F || c == ',' || c == ';' || c == '"') c = '_';
  }
  return word;
}

}  // namespace

Status write_mesh_ply(const std::string& path, const geometry::TriangleMesh& mesh) {
  if (mesh.vertices_mm.size() > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max()))
    return Error{"the mesh has more vertices than a PLY file's int indices can name", "decimate the mesh",
                 path};
  PALPATE_ASSIGN(AtomicFile file, AtomicFile::create(path));
  Status status =
      file.write(fmt::format("{}element vertex {}\n{}element face {}\nproperty list uchar int "
                             "vertex_indices\nend_header\n",
                             kStart, mesh.vertices_mm.size(), kPosition, mesh.triangles.size()));
  if (!status) return status;
  RowWriter rows(file);
  for (const Vec3& p : mesh.vertices_mm) {
    rows.point(p);
    if (status = rows.end_row(); !status) return status;
  }
  for (const auto& triangle : mesh.triangles) {
    rows.u8(static_cast<std::uint8_t>(triangle.size()));
    for (const std::uint32_t corner : triangle) rows.u32(corner);
    if (status = rows.end_row(); !status) return status;
  }
  if (status = rows.flush(); !status) return status;
  return file.commit();
}

Status write_cloud_ply(const std::string& path, const cloud::Cloud& cloud) {
  PALPATE_ASSIGN(AtomicFile file, AtomicFile::create(path));
  std::string header(kStart);
  // The comments mean this one order.
  if (cloud.raster && cloud.raster->order == cloud::ScanOrder::kRaster)
    header += fmt::format("obj_info num_cols {}\nobj_info num_rows {}\n", cloud.raster->columns,
                          cloud.raster->rows);
  header += fmt::format("element vertex {}\n{}", cloud.size(), kPosition);
  for (const cloud::Property& property : cloud.properties)
    header += fmt::format("property float {}\n", one_word(property.name));
  Status status = file.write(header + "end_header\n");
  if (!status) return status;
  RowWriter rows(file);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    rows.point(cloud.point_mm(i));
    for (const cloud::Property& property : cloud.properties) rows.single(property.values[i]);
    if (status = rows.end_row(); !status) return status;
  }
  if (status = rows.flush(); !status) return status;
  return file.commit();
}

Status write_cloud_text(const std::string& path, const cloud::Cloud& cloud, char separator) {
  PALPATE_ASSIGN(AtomicFile file, AtomicFile::create(path));
  constexpr std::size_t kBlock = std::size_t{1} << 16;
  fmt::memory_buffer text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "# {}\nx_mm{}y_mm{}z_mm", kMark, separator, separator);
  for (const cloud::Property& property : cloud.properties)
    fmt::format_to(out, "{}{}", separator, one_word(property.name));
  text.push_back('\n');
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.point_mm(i);
    fmt::format_to(out, "{}{}{}{}{}", p.x(), separator, p.y(), separator, p.z());
    for (const cloud::Property& property : cloud.properties)
      fmt::format_to(out, "{}{}", separator, property.values[i]);
    text.push_back('\n');
    if (text.size() < kBlock && i + 1 < cloud.size()) continue;
    PALPATE_TRY(file.write(std::string_view(text.data(), text.size())));
    text.clear();
  }
  return file.commit();
}

const std::vector<std::string>& cloud_extensions() {
  static const std::vector<std::string> kEndings = {"ply", "xyz", "txt", "asc", "csv"};
  return kEndings;
}

Status write_cloud(const std::string& path, const cloud::Cloud& cloud) {
  const std::string ending = lower_case(std::filesystem::path(path).extension().string());
  if (ending == ".ply") return write_cloud_ply(path, cloud);
  const auto& known = cloud_extensions();
  if (ending.empty() || std::find(known.begin(), known.end(), ending.substr(1)) == known.end())
    return Error{fmt::format("no cloud can be written as '{}'", ending),
                 "choose from .ply, .xyz, .txt, .asc, .csv", path};
  return write_cloud_text(path, cloud, ending == ".csv" ? ',' : ' ');
}

bool is_written_by_palpate(const std::string& path) {
  constexpr std::size_t kFirstLines = 128;  // the mark stands within the first 60 letters
  Result<InputFile> file = InputFile::open(path);
  if (!file) return false;
  std::string start(kFirstLines, '\0');
  const Result<std::size_t> got = file->read(std::as_writable_bytes(std::span(start)));
  return got && std::string_view(start).substr(0, *got).find(kMark) != std::string_view::npos;
}

}  // namespace palpate::io
