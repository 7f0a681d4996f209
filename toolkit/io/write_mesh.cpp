#include "toolkit/io/write_mesh.h"

#include <fmt/format.h>

#include <bit>
#include <cstring>
#include <limits>
#include <vector>

#include "toolkit/io/atomic_file.h"

namespace palpate::io {
namespace {

// Collects rows and hands them to the file in large blocks, least significant byte first on every machine.
class RowWriter {
 public:
  explicit RowWriter(AtomicFile& file) : file_(file) { buffer_.reserve(kBlock); }

  template <class U>
  void bits(U value) {
    for (std::size_t i = 0; i < sizeof(U); ++i)
      buffer_.push_back(static_cast<std::byte>(static_cast<std::uint8_t>(value >> (8 * i))));
  }
  void real(double value) { bits(std::bit_cast<std::uint64_t>(value)); }
  void single(float value) { bits(std::bit_cast<std::uint32_t>(value)); }
  void point(const Vec3& p) {
    real(p.x());
    real(p.y());
    real(p.z());
  }
  void byte(std::uint8_t value) { buffer_.push_back(static_cast<std::byte>(value)); }
  Status end_row() { return buffer_.size() < kBlock ? Status(Done{}) : flush(); }
  Status flush() {
    Status written = file_.write(buffer_);
    buffer_.clear();
    return written;
  }

 private:
  static constexpr std::size_t kBlock = std::size_t{1} << 16;
  AtomicFile& file_;
  std::vector<std::byte> buffer_;
};

constexpr std::string_view kStart =
    "ply\nformat binary_little_endian 1.0\ncomment written by palpate\ncomment unit mm\n";
constexpr std::string_view kPosition = "property double x\nproperty double y\nproperty double z\n";

// PLY separates words by blanks, so a name must be one word.
std::string one_word(const std::string& name) {
  std::string word = name.empty() ? std::string("unnamed") : name;
  for (char& c : word) {
    if (c <= ' ' || c == 0x7F) c = '_';
  }
  return word;
}

}  // namespace

Status write_mesh_ply(const std::string& path, const geometry::TriangleMesh& mesh) {
  if (mesh.vertices_mm.size() > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max()))
    return Error{"the mesh has more vertices than a PLY file's int indices can name", "decimate the mesh",
                 path, 0};
  Result<AtomicFile> file = AtomicFile::create(path);
  if (!file) return std::move(file).error();
  Status status =
      file->write(fmt::format("{}element vertex {}\n{}element face {}\nproperty list uchar int "
                              "vertex_indices\nend_header\n",
                              kStart, mesh.vertices_mm.size(), kPosition, mesh.triangles.size()));
  if (!status) return status;
  RowWriter rows(*file);
  for (const Vec3& p : mesh.vertices_mm) {
    rows.point(p);
    if (status = rows.end_row(); !status) return status;
  }
  for (const auto& triangle : mesh.triangles) {
    rows.byte(static_cast<std::uint8_t>(triangle.size()));
    for (const std::uint32_t corner : triangle) rows.bits(corner);
    if (status = rows.end_row(); !status) return status;
  }
  if (status = rows.flush(); !status) return status;
  return file->commit();
}

Status write_cloud_ply(const std::string& path, const cloud::Cloud& cloud) {
  Result<AtomicFile> file = AtomicFile::create(path);
  if (!file) return std::move(file).error();
  std::string header(kStart);
  // The comments mean this one order.
  if (cloud.raster && cloud.raster->order == cloud::ScanOrder::kRaster)
    header += fmt::format("obj_info num_cols {}\nobj_info num_rows {}\n", cloud.raster->columns,
                          cloud.raster->rows);
  header += fmt::format("element vertex {}\n{}", cloud.size(), kPosition);
  for (const cloud::Property& property : cloud.properties)
    header += fmt::format("property float {}\n", one_word(property.name));
  Status status = file->write(header + "end_header\n");
  if (!status) return status;
  RowWriter rows(*file);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    rows.point(cloud.point_mm(i));
    for (const cloud::Property& property : cloud.properties) rows.single(property.values[i]);
    if (status = rows.end_row(); !status) return status;
  }
  if (status = rows.flush(); !status) return status;
  return file->commit();
}

}  // namespace palpate::io
