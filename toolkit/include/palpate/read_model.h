// Files of scans and meshes: readers of every format, writers.
//
// First:
//   palpate::io::Readers readers;
//   palpate::io::add_standard_readers(readers);
//   palpate::io::ReadOptions options;
//   options.unit = palpate::io::Unit::kMetre;
//   auto model = readers.read("dragon_vrip.ply.gz", options);
//   if (!model) return failed(model.error());
//   scene.models[0].cloud = std::make_shared<const palpate::cloud::Cloud>(std::move(model->cloud));
//
// Writing:
//   if (auto wrote = palpate::io::write_cloud("felt.ply", cloud); !wrote) return failed(wrote.error());
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/progress.h>
#include <palpate/result.h>

namespace palpate::io {

/// The length of one file unit.
enum class Unit { kMetre, kCentimetre, kMillimetre, kMicrometre, kInch };
[[nodiscard]] double mm_per(Unit unit) noexcept;
/// "m", "cm", "mm", "um", "in".
[[nodiscard]] std::string_view unit_name(Unit unit) noexcept;
/// Parses short and long names ("metre", "millimeter", "inch", ..), ignoring case.
[[nodiscard]] Result<Unit> parse_unit(std::string_view text);

struct ReadOptions {
  /// Overrides the file's unit. Empty: the file's own statement, else a guess with a warning.
  std::optional<Unit> unit;
  /// Non-finite points are dropped with a warning, or refused. Dropping is the default because organised
  /// scanner files write missing returns as NaN.
  cloud::NonFinite non_finite = cloud::NonFinite::kDrop;
  /// Multiplies the coordinates after the unit conversion; finite and above 0.
  double scale = 1.0;
  /// Post distance in mm of a height grid, replacing the file's; 0: the file's. Applied before `scale`. An
  /// Error for other files.
  double post_mm = 0.0;
  /// Height in mm of the grid's number 1, replacing the unit; 0: the unit. Applied before `scale`; finite,
  /// not negative. Height grids only.
  double vertical_mm = 0.0;
  /// A further number that marks missing heights. Height grids only.
  std::optional<double> no_data;
  /// Keeps the points in this box alone, its faces included: in mm, after unit and scale. A file without any
  /// is an Error. Faces that lose a corner go; a raster becomes the columns "row" and "column".
  std::optional<geometry::Aabb> within_mm;
  /// Bounds the decoded memory and the size that a compressed file may unpack to.
  std::uint64_t max_bytes = kMemoryLimitBytes;
};

/// An Error for the first invalid number of `options`, or nothing.
[[nodiscard]] Status check(const ReadOptions& options);
/// An Error for a box in mm whose corners are not finite, or not the low one before the high one. O(1).
[[nodiscard]] Status check_box(const geometry::Aabb& box_mm);

/// Contents of a file, mm.
struct ReadModel {
  cloud::Cloud cloud;
  /// The file's faces, or null. Vertex i is point i of the cloud in double precision. Polygons become
  /// triangle fans. Never changed after reading, so it may be shared.
  std::shared_ptr<geometry::TriangleMesh> mesh;
  Unit unit = Unit::kMillimetre;
  bool unit_guessed = false;
  std::size_t file_points = 0;        ///< before dropping
  std::size_t non_finite = 0;         ///< points dropped because they are not finite
  std::size_t outside = 0;            ///< points left out by ReadOptions::within_mm
  std::size_t dropped_faces = 0;      ///< faces with a dropped or missing point, or fewer than three corners
  double max_rounding_mm = 0.0;       ///< largest difference per axis between file and stored coordinate
  std::vector<std::string> warnings;  ///< whole sentences, for a person
  std::string format;                 ///< "PLY, ASCII", "PCD, binary_compressed", ..
  std::string compression;            ///< "", "gzip" or "xz"
  /// FNV-1a over x, y, z of the kept points in order, as doubles in mm before rounding (Hash64::real).
  std::uint64_t content_hash = 0;
};

class ByteSource;    // toolkit/io/byte_source.h
struct DecodedFile;  // toolkit/io/decoding.h, as ReaderInput
struct ReaderInput;
/// A format: decodes the file's bytes into numbers.
using Reader = std::function<Result<DecodedFile>(const ReaderInput&)>;

/// The known formats, by file name extension. Add them before use; read() is const and thread-safe.
class Readers {
 public:
  /// `extensions` are lower case without the dot ({"xyz", "txt"}). A later reader replaces an earlier one.
  void add(const std::vector<std::string>& extensions, const Reader& reader);
  /// Sorted, without the dot.
  [[nodiscard]] std::vector<std::string> extensions() const;
  /// The reader of an extension, or null. Valid until the next add().
  [[nodiscard]] const Reader* find(std::string_view extension) const;

  /// Reads a file. Gzip and xz are detected by the first bytes and decompressed; the name without .gz or .xz
  /// gives the format. Memory is bounded by options.max_bytes and the file's content, time by its decoded
  /// size.
  [[nodiscard]] Result<ReadModel> read(const std::string& path, const ReadOptions& options,
                                       Progress& progress = no_progress()) const;
  /// Reads from any source; `name` gives the format and appears in messages.
  [[nodiscard]] Result<ReadModel> read(std::unique_ptr<ByteSource> source, const std::string& name,
                                       const ReadOptions& options, Progress& progress = no_progress()) const;

 private:
  struct Entry {
    std::string extension;
    Reader reader;
  };
  std::vector<Entry> entries_;
};

/// Adds PLY, XYZ/CSV/TXT/ASC, OBJ, OFF, STL, PFM, LAS, LAZ, E57, PTX and PTS. PCD (toolkit/pcd) and GDAL's
/// height grids (toolkit/dem) are separate targets.
void add_standard_readers(Readers& readers);

// Writers. Every file is complete or absent (AtomicFile).

/// Writes binary little-endian PLY: double x y z in mm, faces of three int indices, and the comment "unit
/// mm", which read_model takes as the unit.
Status write_mesh_ply(const std::string& path, const geometry::TriangleMesh& mesh);

/// Writes binary little-endian PLY: double x y z in mm, a float per property, the comment "unit mm", and a
/// raster whose rows run one way as obj_info num_cols and num_rows. read_model reads all of it.
Status write_cloud_ply(const std::string& path, const cloud::Cloud& cloud);

/// Writes text that read_model reads: a comment, the column names (x_mm, y_mm, z_mm, properties), and a row
/// per point, separated by commas or blanks, with the fewest digits that read back to the same bits.
Status write_cloud_text(const std::string& path, const cloud::Cloud& cloud, char separator);

/// Extensions of write_cloud(), without the dot.
[[nodiscard]] const std::vector<std::string>& cloud_extensions();
/// Chooses PLY or text by the extension; the Error for others lists the extensions.
Status write_cloud(const std::string& path, const cloud::Cloud& cloud);

/// True if the first lines say that the functions above wrote the file.
[[nodiscard]] bool is_written_by_palpate(const std::string& path);

}  // namespace palpate::io

// PCD files through PCL: ASCII, binary, binary_compressed, organised. A separate target (palpate::pcd),
// because PCL's io library brings VTK.

namespace palpate::pcd {

inline constexpr const char* kPcdExtension = "pcd";

/// Adds .pcd. Our own check compares header and file size before PCL sees the file (toolkit/io/pcd_header.h).
/// PCL's exceptions and prints stay in this module. The unit is metres by PCL's convention unless
/// ReadOptions::unit is set. An organised cloud keeps its raster unless it has holes (non-finite points).
void add_pcd_reader(io::Readers& readers);

}  // namespace palpate::pcd

// Height grids through GDAL: GeoTIFF and plain TIFF, 16-bit PNG, SRTM (.hgt, .hgt.zip), USGS DEM, ESRI ASCII
// grids (.asc). A separate target (palpate::dem), because GDAL brings a hundred libraries.

namespace palpate::dem {

/// Extensions that add_dem_readers() adds; zip: an SRTM tile in a ZIP archive.
inline constexpr const char* kDemExtensions[] = {"tif", "tiff", "png", "hgt", "dem", "asc", "zip"};

/// Adds the DEM readers. Call it after add_standard_readers(): an .asc file that is no ESRI grid is still
/// read as columns of numbers.
///
/// Points are the posts, in rows from the south, each from the west; the south-west post is at (0, 0). Posts
/// without data are dropped and counted as non-finite points: holes. Spacing is the file's; spacing in
/// degrees is converted on the WGS 84 ellipsoid at the file's middle, with a warning. ReadOptions::post_mm
/// and vertical_mm override both units.
/// Our own check compares header and size first (dem_check.h). GDAL then reads from memory only, with these
/// formats' drivers, without network, and its prints stay in this module. Thread-safe.
void add_dem_readers(io::Readers& readers);

}  // namespace palpate::dem
