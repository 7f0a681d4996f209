// Reading scans and meshes: formats, units, points that are not finite, faces.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/io/byte_source.h"

namespace palpate::io {

/// The length that the number 1 in a file stands for.
enum class Unit { kMetre, kCentimetre, kMillimetre, kMicrometre, kInch };
[[nodiscard]] double mm_per(Unit unit) noexcept;
/// "m", "cm", "mm", "um", "in".
[[nodiscard]] std::string_view unit_name(Unit unit) noexcept;
/// The short names above and the long ones ("metre", "millimeter", "inch", ..), whatever the case.
[[nodiscard]] Result<Unit> parse_unit(std::string_view text);

struct ReadOptions {
  /// Overrides what the file says; empty: the file's own statement, else a guess with a warning.
  std::optional<Unit> unit;
  /// Points that are not finite: dropped, counted and warned of, or refused. Dropping is the default, because
  /// a missing return is written as NaN by every organised scanner file.
  cloud::NonFinite non_finite = cloud::NonFinite::kDrop;
  /// Multiplies the coordinates after the unit; finite and above 0.
  double scale = 1.0;
  /// Grids of heights only, an Error for any other file: the distance of posts in mm, instead of the file's;
  /// 0: the file's. Before `scale`.
  double post_mm = 0.0;
  /// Grids of heights only: mm of height that the number 1 stands for, instead of the unit; 0: the unit.
  /// Before `scale`. Both finite, not negative.
  double vertical_mm = 0.0;
  /// Grids of heights only: the file's number that stands for no height, beside the one that the file names.
  std::optional<double> no_data;
  /// Bound on the memory of what is decoded, and on the bytes that a compressed file may unpack to.
  std::uint64_t max_bytes = kMemoryLimitBytes;
};

/// The first number of `options` that is none, or out of its range, or nothing.
[[nodiscard]] Status check(const ReadOptions& options);

/// What a file held, in mm.
struct ReadModel {
  cloud::Cloud cloud;
  /// The file's faces, or null where it has none. Vertex i is point i of the cloud, in double precision (the
  /// cloud's float coordinates are a rounding of it). Polygons are cut into fans. Never changed after
  /// reading: share it.
  std::shared_ptr<geometry::TriangleMesh> mesh;
  Unit unit = Unit::kMillimetre;
  bool unit_guessed = false;
  std::size_t file_points = 0;  ///< before dropping
  std::size_t non_finite = 0;   ///< points dropped because they are not finite
  std::size_t dropped_faces =
      0;  ///< faces that used a dropped or missing point, or had fewer than three corners
  double max_rounding_mm = 0.0;  ///< largest distance, per axis, between the file's and the stored coordinate
  std::vector<std::string> warnings;  ///< whole sentences, for a person
  std::string format;                 ///< "PLY, ASCII", "PCD, binary_compressed", ..
  std::string compression;            ///< "", "gzip" or "xz"
  /// FNV-1a over x, y, z of every kept point in order, as doubles in mm before rounding (Hash64::real).
  std::uint64_t content_hash = 0;
};

/// What a format's reader hands on: the file's numbers before unit, scale and cleaning.
struct DecodedFile {
  std::vector<Vec3> points;
  std::vector<cloud::Property> properties;              ///< each as long as `points`
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< may name points that do not exist
  std::vector<bool> continues_face;  ///< as long as `triangles`: same polygon as the one before
  std::size_t dropped_faces = 0;     ///< faces already given up while reading
  std::optional<cloud::ScanRaster> raster;
  /// Of a raster with holes, by point: the position that it stands at, row * columns + column; else empty.
  std::vector<std::uint32_t> position_of;
  std::uint32_t position_columns = 0;
  bool single_precision = false;          ///< the file itself holds its coordinates as 32-bit floats
  bool height_grid = false;               ///< made by add_row(), which alone knows posts and heights
  std::optional<Unit> unit;               ///< where the file itself says it
  std::optional<Unit> conventional_unit;  ///< where the format has a convention: a better guess
  std::vector<std::string> warnings;
  std::string format;

  [[nodiscard]] std::size_t bytes() const noexcept;
};

/// What a format's reader is given. `bytes` is decompressed already; `name` is for messages.
struct ReaderInput {
  ByteSource& bytes;
  const std::string& name;
  const ReadOptions& options;
  Progress& progress;
};
using Reader = std::function<Result<DecodedFile>(const ReaderInput&)>;

/// Unit, scale, cleaning, the cloud, the mesh and the hash: the same for all formats. O(points + faces).
[[nodiscard]] Result<ReadModel> finish_model(DecodedFile&& decoded, const ReadOptions& options,
                                             const std::string& name);

/// The formats that are understood, by file name extension. Add before use; read() is const and thread-safe.
class Readers {
 public:
  /// `extensions` in lower case without the dot ({"xyz", "txt"}). A later reader replaces an earlier one.
  void add(const std::vector<std::string>& extensions, const Reader& reader);
  /// Sorted, without the dot.
  [[nodiscard]] std::vector<std::string> extensions() const;
  /// The reader of an extension, or null. Valid until the next add().
  [[nodiscard]] const Reader* find(std::string_view extension) const;

  /// Reads a file, decompressing where its first bytes say gzip or xz; the format goes by the name without
  /// .gz or .xz. Memory is bounded by options.max_bytes and by what the file really holds, time by the file's
  /// (decoded) size.
  [[nodiscard]] Result<ReadModel> read(const std::string& path, const ReadOptions& options,
                                       Progress& progress = no_progress()) const;
  /// The same from any source; `name` chooses the format and appears in messages.
  [[nodiscard]] Result<ReadModel> read(std::unique_ptr<ByteSource> source, const std::string& name,
                                       const ReadOptions& options, Progress& progress = no_progress()) const;

 private:
  struct Entry {
    std::string extension;
    Reader reader;
  };
  std::vector<Entry> entries_;
};

/// PLY, XYZ/CSV/TXT/ASC/PTS, OBJ, OFF, PFM. PCD comes with toolkit/pcd, height grids that need GDAL with
/// toolkit/dem, targets of their own.
void add_standard_readers(Readers& readers);

}  // namespace palpate::io
