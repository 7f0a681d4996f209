#include <palpate/read_model.h>

#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_string.h>
#include <cpl_vsi.h>
#include <fmt/format.h>
#include <gdal.h>
#include <gdal_frmts.h>
#include <ogr_srs_api.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>
#include <numbers>
#include <vector>

#include <palpate/result.h>
#include "toolkit/dem/dem_check.h"
#include "toolkit/io/decoding.h"
#include "toolkit/io/height_grid.h"

namespace palpate::dem {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;
constexpr double kDegreesMost = 360.0;
/// GDAL reads and keeps whole blocks of a file; larger ones than this no writer makes.
constexpr std::uint64_t kMaxBlockPosts = std::uint64_t{1} << 26;

/// GDAL's messages: kept, never printed. On this thread, while it lives.
class Messages {
 public:
  Messages() { CPLPushErrorHandlerEx(&Messages::take, this); }
  ~Messages() { CPLPopErrorHandler(); }
  Messages(const Messages&) = delete;
  Messages& operator=(const Messages&) = delete;
  [[nodiscard]] Error error(const std::string& what) const {
    return Error{last_.empty() ? what : what + ": " + shown(last_),
                 "check it with another program, or fetch it again"};
  }

 private:
  static void CPL_STDCALL take(CPLErr level, CPLErrorNum, const char* text) {
    if (level < CE_Failure) return;
    static_cast<Messages*>(CPLGetErrorHandlerUserData())->last_ = text;
  }
  std::string last_;
};

/// A setting of GDAL on this thread, while it lives.
class Setting {
 public:
  Setting(const char* key, const char* value) : key_(key) {
    const char* before = CPLGetThreadLocalConfigOption(key, nullptr);
    if (before != nullptr) before_ = std::make_unique<std::string>(before);
    CPLSetThreadLocalConfigOption(key, value);
  }
  ~Setting() { CPLSetThreadLocalConfigOption(key_, before_ ? before_->c_str() : nullptr); }
  Setting(const Setting&) = delete;
  Setting& operator=(const Setting&) = delete;

 private:
  const char* key_;
  std::unique_ptr<std::string> before_;
};

/// A file in GDAL's memory file system, in a folder of its own; gone with this.
class MemoryFile {
 public:
  MemoryFile(std::vector<std::byte>& bytes, const std::string& name) {
    static std::atomic<std::uint64_t> count{0};
    path_ = fmt::format("/vsimem/palpate-{}/{}", count++, name);
    // GDAL wants a pointer it may write through; it is opened for reading alone.
    VSILFILE* file = VSIFileFromMemBuffer(path_.c_str(), reinterpret_cast<GByte*>(bytes.data()),
                                          static_cast<vsi_l_offset>(bytes.size()), FALSE);
    if (file != nullptr) (void)VSIFCloseL(file);
  }
  ~MemoryFile() { (void)VSIUnlink(path_.c_str()); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  std::string path_;
};

struct Close {
  void operator()(void* dataset) const { GDALClose(dataset); }
};
using Dataset = std::unique_ptr<void, Close>;

void register_drivers() {
  static std::once_flag once;
  std::call_once(once, [] {
    GDALRegister_GTiff();
    GDALRegister_PNG();
    GDALRegister_SRTMHGT();
    GDALRegister_USGSDEM();
    GDALRegister_AAIGrid();
    OSRSetPROJEnableNetwork(0);
  });
}

const char* driver_of(DemFormat format) {
  switch (format) {
    case DemFormat::kTiff:
      return "GTiff";
    case DemFormat::kPng:
      return "PNG";
    case DemFormat::kUsgs:
      return "USGSDEM";
    case DemFormat::kEsriAscii:
      return "AAIGrid";
    default:
      return "SRTMHGT";
  }
}

const char* name_of(DemFormat format) {
  switch (format) {
    case DemFormat::kTiff:
      return "TIFF";
    case DemFormat::kPng:
      return "PNG";
    case DemFormat::kUsgs:
      return "USGS DEM";
    case DemFormat::kEsriAscii:
      return "ESRI ASCII grid";
    default:
      return "SRTM tile";
  }
}

/// Metres of one degree of longitude and of latitude on the WGS 84 ellipsoid.
struct Degree {
  double east_m, north_m;
};
Degree degree_at(double latitude_deg) {
  constexpr double kAxisM = 6378137.0, kFlattening = 1.0 / 298.257223563;
  constexpr double kEccentricitySq = kFlattening * (2.0 - kFlattening);
  const double sine = std::sin(latitude_deg * kRadiansPerDegree);
  const double w_sq = 1.0 - kEccentricitySq * sine * sine;
  const double across = kAxisM / std::sqrt(w_sq);
  return {kRadiansPerDegree * across * std::cos(latitude_deg * kRadiansPerDegree),
          kRadiansPerDegree * across * (1.0 - kEccentricitySq) / w_sq};
}

/// Metres that 1 in the file's heights stands for, by the band's unit.
double metres_per_height(const std::string& unit) {
  constexpr double kFoot = 0.3048, kSurveyFoot = 1200.0 / 3937.0;
  if (unit == "ft" || unit == "foot" || unit == "feet") return kFoot;
  if (unit == "US survey foot" || unit == "us-ft" || unit == "ftUS") return kSurveyFoot;
  if (unit == "cm") return 0.01;
  if (unit == "mm") return 0.001;
  if (unit == "km") return 1000.0;
  return 1.0;
}

class DemReader {
 public:
  DemReader(const io::ReaderInput& input, DemFormat format, GDALDatasetH dataset)
      : input_(input), format_(format), dataset_(dataset), band_(GDALGetRasterBand(dataset, 1)) {}

  Result<io::DecodedFile> read(std::uint64_t file_bytes, const Messages& messages) {
    if (band_ == nullptr) return messages.error("the file has no raster");
    grid_.columns = static_cast<std::uint64_t>(std::max(0, GDALGetRasterXSize(dataset_)));
    grid_.rows = static_cast<std::uint64_t>(std::max(0, GDALGetRasterYSize(dataset_)));
    PALPATE_TRY(check_size(format_, grid_.columns, grid_.rows, file_bytes, input_.options));
    int block_x = 0, block_y = 0;
    GDALGetBlockSize(band_, &block_x, &block_y);
    if (block_x <= 0 || block_y <= 0 ||
        static_cast<std::uint64_t>(block_x) * static_cast<std::uint64_t>(block_y) > kMaxBlockPosts)
      return Error{fmt::format("blocks of {} x {} posts are too large", block_x, block_y),
                   "write the file in tiles or strips"};
    measure();
    decoded_.format = name_of(format_);
    PALPATE_TRY(read_rows(messages));
    decoded_.raster =
        cloud::ScanRaster{static_cast<std::uint32_t>(grid_.columns), static_cast<std::uint32_t>(grid_.rows)};
    return std::move(decoded_);
  }

 private:
  void warn(std::string text) { decoded_.warnings.push_back(std::move(text)); }

  /// Distances of posts and what heights stand for, in metres; an image without a place on Earth is in mm.
  void measure() {
    double t[6] = {0, 1, 0, 0, 0, 1};
    const bool placed = GDALGetGeoTransform(dataset_, t) == CE_None;
    const double east = std::hypot(t[1], t[4]), south = std::hypot(t[2], t[5]);
    const bool turned = t[2] != 0.0 || t[4] != 0.0;
    north_up_ = !(t[5] > 0.0) || !placed;
    if (GDALGetRasterCount(dataset_) > 1) warn("Only the first of several bands was read.");
    if (GDALGetRasterDataType(band_) == GDT_Byte)
      warn("The heights have 8 bits: 256 steps, which are felt as steps.");
    if (!placed || !(east > 0.0) || !(south > 0.0) || !std::isfinite(east) || !std::isfinite(south)) {
      decoded_.conventional_unit = grid_.unit = io::Unit::kMillimetre;
      if (!(input_.options.post_mm > 0.0))
        warn("The file does not say how far apart its posts are; taken as 1. Give it with --post-mm.");
      return;
    }
    if (turned) warn("The grid is turned against north; its rows were taken as running east.");
    decoded_.unit = grid_.unit = io::Unit::kMetre;
    const OGRSpatialReferenceH place = GDALGetSpatialRef(dataset_);
    const double middle_y =
        t[3] + 0.5 * static_cast<double>(grid_.columns) * t[4] + 0.5 * static_cast<double>(grid_.rows) * t[5];
    const bool in_degrees = place != nullptr ? OSRIsGeographic(place) != 0 : looks_like_degrees(t);
    if (in_degrees)
      use_degrees(east, south, middle_y, place == nullptr);
    else
      use_lengths(east, south, place);
    const char* unit = GDALGetRasterUnitType(band_);
    grid_.per_height = metres_per_height(unit == nullptr ? std::string() : std::string(unit));
  }

  bool looks_like_degrees(const double* t) const {
    return std::abs(t[0]) <= kDegreesMost && std::abs(t[3]) <= kDegreesMost / 4.0 &&
           std::abs(t[1]) * static_cast<double>(grid_.columns) <= kDegreesMost &&
           std::abs(t[5]) * static_cast<double>(grid_.rows) <= kDegreesMost / 2.0 && std::abs(t[1]) < 1.0;
  }
  void use_degrees(double east, double south, double latitude, bool guessed) {
    const Degree degree = degree_at(std::clamp(latitude, -89.0, 89.0));
    grid_.step_x = east * degree.east_m;
    grid_.step_y = south * degree.north_m;
    warn(
        fmt::format("The grid is in degrees{}; posts were taken {:.6g} x {:.6g} m apart, as on the WGS 84 "
                    "ellipsoid at its middle latitude of {:.4f} degrees. Toward its edges that is off as the "
                    "cosine of the latitude.",
                    guessed ? " by its numbers" : "", grid_.step_x, grid_.step_y, latitude));
  }
  void use_lengths(double east, double south, OGRSpatialReferenceH place) {
    double metres = place != nullptr ? OSRGetLinearUnits(place, nullptr) : 1.0;
    if (!(metres > 0.0) || !std::isfinite(metres)) metres = 1.0;
    grid_.step_x = east * metres;
    grid_.step_y = south * metres;
  }

  Status read_rows(const Messages& messages) {
    int has = 0;
    if (const double none = GDALGetRasterNoDataValue(band_, &has); has != 0) grid_.no_data = none;
    if (const double scale = GDALGetRasterScale(band_, &has); has != 0) grid_.scale = scale;
    if (const double offset = GDALGetRasterOffset(band_, &has); has != 0) grid_.offset = offset;
    const auto columns = static_cast<int>(grid_.columns), rows = static_cast<int>(grid_.rows);
    std::vector<double> heights(grid_.columns);
    decoded_.points.reserve(grid_.columns * grid_.rows);
    for (int row = 0; row < rows; ++row) {
      // Points go from the south up, files from the north down.
      const int at = north_up_ ? rows - 1 - row : row;
      if (GDALRasterIO(band_, GF_Read, 0, at, columns, 1, heights.data(), columns, 1, GDT_Float64, 0, 0) !=
          CE_None)
        return messages.error(fmt::format("row {} cannot be read", at + 1));
      io::add_row(grid_, static_cast<std::uint64_t>(row), heights, input_.options, decoded_);
      if (row % kRowsPerReport != 0) continue;
      input_.progress.report("reading", static_cast<double>(row) / rows);
      if (input_.progress.cancelled()) return Error{"reading was stopped"};
    }
    io::warn_of_no_data(grid_, decoded_);
    return Done{};
  }

  static constexpr int kRowsPerReport = 64;
  const io::ReaderInput& input_;
  DemFormat format_;
  GDALDatasetH dataset_;
  GDALRasterBandH band_;
  io::HeightGrid grid_;
  io::DecodedFile decoded_;
  bool north_up_ = true;
};

Result<io::DecodedFile> through_gdal(const io::ReaderInput& input, DemFormat format,
                                     std::vector<std::byte>& bytes, const std::string& name) {
  register_drivers();
  const Messages messages;
  const Setting no_siblings("GDAL_DISABLE_READDIR_ON_OPEN", "EMPTY_DIR");
  const Setting no_side_files("GDAL_PAM_ENABLED", "NO");
  const MemoryFile file(bytes, name);
  const std::string path = format == DemFormat::kZip ? "/vsizip/" + file.path() : file.path();
  const char* const drivers[] = {driver_of(format), nullptr};
  const Dataset dataset(
      GDALOpenEx(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY, drivers, nullptr, nullptr));
  if (dataset == nullptr) return messages.error(fmt::format("it is no {} that can be read", name_of(format)));
  return DemReader(input, format, dataset.get()).read(bytes.size(), messages);
}

/// The only file of an archive, unpacked; at most as large as an SRTM tile can be.
Result<std::vector<std::byte>> unpack(std::vector<std::byte>& archive, std::string& name) {
  constexpr std::uint64_t kMaxBytes = std::uint64_t{3601} * 3601 * 2;
  const Messages messages;
  const MemoryFile file(archive, "archive.zip");
  const std::string folder = "/vsizip/" + file.path();
  char** const list = VSIReadDir(folder.c_str());
  const int count = CSLCount(list);
  for (int i = 0; i < count && name.empty(); ++i)
    if (io::lower_case(list[i]).ends_with(".hgt")) name = list[i];
  CSLDestroy(list);
  if (name.empty() || name.find('/') != std::string::npos)
    return Error{"the archive holds no SRTM tile (.hgt)", "unpack it, and give the file inside"};
  VSILFILE* const inside = VSIFOpenL((folder + "/" + name).c_str(), "rb");
  if (inside == nullptr) return messages.error("the archive cannot be read");
  std::vector<std::byte> tile(kMaxBytes + 1);
  tile.resize(VSIFReadL(tile.data(), 1, tile.size(), inside));
  (void)VSIFCloseL(inside);
  return tile;
}

/// The file's own name: of SRTM tiles it says where they are.
std::string plain_name(const std::string& path, std::string_view extension) {
  const std::string name = path.substr(path.find_last_of('/') + 1);
  std::string kept;
  for (const char c : name.substr(0, name.find('.')))
    kept += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
  return kept + "." + std::string(extension);
}

Result<io::DecodedFile> read_dem(const io::ReaderInput& input, std::string_view extension) {
  input.progress.report("reading", 0.0);
  PALPATE_ASSIGN(std::vector<std::byte> bytes, io::read_all(input.bytes, input.options.max_bytes));
  if (extension == "asc" || extension == "dem") {  // the formats that are text
    PALPATE_ASSIGN(const std::size_t mark,
                   byte_order_mark({reinterpret_cast<const char*>(bytes.data()), bytes.size()}));
    bytes.erase(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(mark));
  }
  if (extension == "asc" && !is_esri_ascii(bytes)) {
    io::MemorySource source(bytes);
    return io::read_xyz({source, input.name, input.options, input.progress});
  }
  PALPATE_ASSIGN(DemFormat format, format_of(extension, bytes));
  std::string name = plain_name(input.name, extension);
  if (format == DemFormat::kZip) {
    std::string inside;
    PALPATE_ASSIGN(bytes, unpack(bytes, inside));
    format = DemFormat::kHgt;
    name = plain_name(inside, "hgt");
  }
  PALPATE_TRY(check_header(format, bytes, input.options));
  return through_gdal(input, format, bytes, name);
}

}  // namespace

void add_dem_readers(io::Readers& readers) {
  for (const char* extension : kDemExtensions)
    readers.add({extension},
                [extension](const io::ReaderInput& input) { return read_dem(input, extension); });
}

}  // namespace palpate::dem
