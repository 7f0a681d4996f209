// Height grids through GDAL: heights, distances, holes; lying headers; real tiles where they are.
#include <palpate/read_model.h>

#include <cpl_conv.h>
#include <cpl_vsi.h>
#include <gdal.h>
#include <gtest/gtest.h>
#include <ogr_srs_api.h>

#include <cmath>
#include <memory>
#include <span>
#include <vector>

#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/cloud/height_field.h"
#include "toolkit/core/random.h"
#include "toolkit/dem/dem_check.h"
#include "toolkit/io/byte_source.h"

namespace palpate::dem {
namespace {

Result<io::ReadModel> read(const std::string& content, const std::string& name,
                           const io::ReadOptions& options = {}) {
  io::Readers readers;
  io::add_standard_readers(readers);
  add_dem_readers(readers);
  return readers.read(std::make_unique<io::MemorySource>(std::as_bytes(std::span(content))), name, options);
}

bool warns(const io::ReadModel& model, const std::string& of) {
  return test::any_says(model.warnings, of);
}

std::string esri(const std::string& rows,
                 const std::string& corner = "xllcorner 500000\nyllcorner 4000000\n") {
  return "ncols 3\nnrows 2\n" + corner + "cellsize 10\nNODATA_value -9999\n" + rows;
}

TEST(Dem, EsriAscii) {
  const auto model = test::value_of(read(esri("1 2 3\n4 5 6\n"), "a.asc"));
  EXPECT_EQ(model.format, "ESRI ASCII grid");
  ASSERT_TRUE(model.cloud.raster);
  EXPECT_EQ(model.cloud.raster->columns, 3u);
  // From the south-west: the file's last row first; 10 m apart.
  EXPECT_EQ(model.cloud.point_mm(0), Vec3(0, 0, 4000));
  EXPECT_EQ(model.cloud.point_mm(2), Vec3(20000, 0, 6000));
  EXPECT_EQ(model.cloud.point_mm(3), Vec3(0, 10000, 1000));
}

TEST(Dem, AByteOrderMarkBeforeAnEsriGrid) {
  const std::string grid = esri("1 2 3\n4 5 6\n");
  const auto plain = read(grid, "a.asc"), marked = read("\xEF\xBB\xBF" + grid, "a.asc");
  ASSERT_TRUE(plain && marked) << marked.error().message();
  EXPECT_EQ(marked->content_hash, plain->content_hash);
  EXPECT_TRUE(test::refused(read(std::string("\xFF\xFEn\0", 4), "a.asc"), "UTF-16"));
}

TEST(Dem, AColumnFileIsStillOne) {
  const auto model = test::value_of(read("1 2 3\n4 5 6\n7 8 9\n", "a.asc"));
  EXPECT_TRUE(model.format.starts_with("columns of text")) << model.format;
  EXPECT_EQ(model.cloud.size(), 3u);
}

TEST(Dem, HolesAreCountedAndKeptByTheField) {
  std::string rows;
  for (int row = 0; row < 20; ++row) {
    for (int column = 0; column < 20; ++column)
      rows += (row == 5 && column == 7 ? "-9999" : std::to_string(row)) + std::string(" ");
    rows += "\n";
  }
  const auto model = test::value_of(read(
      "ncols 20\nnrows 20\nxllcorner 0\nyllcorner 0\ncellsize 2000\nNODATA_value -9999\n" + rows, "a.asc"));
  EXPECT_EQ(model.non_finite, 1u);
  EXPECT_TRUE(warns(model, "not finite"));
  const auto field = test::value_of(cloud::height_field_of(model.cloud));
  EXPECT_EQ(field.holes, 1u);
  EXPECT_TRUE(std::isnan(field.height_mm[field.at(7, 14)]));
  io::ReadOptions refuse;
  refuse.non_finite = cloud::NonFinite::kRefuse;
  EXPECT_FALSE(read(esri("1 2 -9999\n4 5 6\n"), "a.asc", refuse));
}

// A number for "no data" that no tag names.
TEST(Dem, UntaggedNoDataIsWarnedOfAndLeftOut) {
  const std::string text =
      "ncols 4\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 10\n-32768 -32768 -32768 7\n1 2 3 4\n5 6 7 8\n";
  const auto seen = test::value_of(read(text, "a.asc"));
  EXPECT_TRUE(warns(seen, "3 of 12 posts hold -32768"));
  EXPECT_TRUE(warns(seen, "--no-data -32768"));
  io::ReadOptions options;
  options.no_data = -32768.0;
  const auto without = test::value_of(read(text, "a.asc", options));
  EXPECT_EQ(without.cloud.size(), 9u);
  EXPECT_FALSE(warns(without, "--no-data"));
}

TEST(Dem, VerticalScaleAndSpacingAreTheirOwn) {
  io::ReadOptions options;
  options.post_mm = 0.1;
  options.vertical_mm = 0.02;
  options.scale = 2.0;
  const auto model = test::value_of(read(esri("1 2 3\n4 5 6\n"), "a.asc", options));
  EXPECT_NEAR((model.cloud.point_mm(5) - Vec3(0.4, 0.2, 0.12)).norm(), 0.0, 1e-7);
  options.unit = io::Unit::kInch;  // of what is not said in mm: nothing is left
  const auto again = test::value_of(read(esri("1 2 3\n4 5 6\n"), "a.asc", options));
  EXPECT_NEAR((again.cloud.point_mm(5) - Vec3(0.4, 0.2, 0.12)).norm(), 0.0, 1e-7);
  options.vertical_mm = -1.0;
  EXPECT_FALSE(read(esri("1 2 3\n4 5 6\n"), "a.asc", options));
}

TEST(Dem, DegreesBecomeMetresWithAWarning) {
  const auto model = test::value_of(
      read("ncols 3\nnrows 3\nxllcorner 10\nyllcorner 59.99\ncellsize 0.01\n1 1 1\n1 1 1\n1 1 1\n", "a.asc"));
  EXPECT_TRUE(warns(model, "degrees"));
  // At 60 degrees a degree of longitude has 55.8 km, one of latitude 111.4 km.
  const Vec3 extent = model.cloud.box_mm().extent_mm();
  EXPECT_NEAR(extent.x() / 2e6, 0.01 * 55.80, 0.01 * 0.03);
  EXPECT_NEAR(extent.y() / 2e6, 0.01 * 111.41, 0.01 * 0.03);
}

/// A file of GDAL's own making, as bytes.
std::string written(const char* driver, const char* name, int columns, int rows,
                    const std::vector<double>& heights, GDALDataType type, double step = 0.0,
                    double none = -1.0) {
  GDALAllRegister();
  GDALDatasetH memory = GDALCreate(GDALGetDriverByName("MEM"), "", columns, rows, 1, type, nullptr);
  GDALRasterBandH band = GDALGetRasterBand(memory, 1);
  std::vector<double> copy = heights;
  EXPECT_EQ(GDALRasterIO(band, GF_Write, 0, 0, columns, rows, copy.data(), columns, rows, GDT_Float64, 0, 0),
            CE_None);
  if (step > 0.0) {
    double place[6] = {600000, step, 0, 5100000, 0, -step};
    GDALSetGeoTransform(memory, place);
    GDALSetRasterNoDataValue(band, none);
    OGRSpatialReferenceH utm = OSRNewSpatialReference(nullptr);
    OSRSetProjCS(utm, "UTM");
    OSRSetWellKnownGeogCS(utm, "WGS84");
    OSRSetUTM(utm, 32, TRUE);
    GDALSetSpatialRef(memory, utm);
    OSRDestroySpatialReference(utm);
  }
  const std::string path = std::string("/vsimem/test/") + name;
  GDALDatasetH file =
      GDALCreateCopy(GDALGetDriverByName(driver), path.c_str(), memory, FALSE, nullptr, nullptr, nullptr);
  EXPECT_NE(file, nullptr);
  GDALClose(file);
  GDALClose(memory);
  vsi_l_offset size = 0;
  const GByte* bytes = VSIGetMemFileBuffer(path.c_str(), &size, FALSE);
  const std::string content(reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(size));
  VSIUnlink(path.c_str());
  return content;
}

std::vector<double> ramp(int columns, int rows) {
  std::vector<double> heights;
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) heights.push_back(300.0 * row + 7.0 * column);
  return heights;
}

TEST(Dem, GeoTiff) {
  std::vector<double> heights = ramp(40, 30);
  heights[45] = -1.0;
  for (const GDALDataType type : {GDT_Int16, GDT_Float32}) {
    const auto model = test::value_of(read(written("GTiff", "a.tif", 40, 30, heights, type, 25.0), "a.tif"));
    EXPECT_EQ(model.unit, io::Unit::kMetre);
    EXPECT_FALSE(model.unit_guessed);
    EXPECT_EQ(model.file_points, 1200u);
    EXPECT_EQ(model.non_finite, 1u);
    EXPECT_NEAR((model.cloud.point_mm(39) - Vec3(25e3 * 39, 0, 1e3 * (300 * 29 + 7 * 39))).norm(), 0.0, 0.5);
  }
}

TEST(Dem, ImagesOfSixteenBits) {
  const std::vector<double> heights = ramp(50, 20);
  for (const auto& [driver, name] : {std::pair("PNG", "a.png"), std::pair("GTiff", "a.tiff")}) {
    const auto model = test::value_of(read(written(driver, name, 50, 20, heights, GDT_UInt16), name));
    EXPECT_TRUE(warns(model, "--post-mm"));
    EXPECT_EQ(model.cloud.point_mm(49), Vec3(49, 0, 300 * 19 + 7 * 49)) << name;
    EXPECT_EQ(model.unit, io::Unit::kMillimetre);
  }
  const auto coarse =
      test::value_of(read(written("PNG", "b.png", 4, 4, std::vector<double>(16, 9), GDT_Byte), "b.png"));
  EXPECT_TRUE(warns(coarse, "8 bits"));
}

TEST(Dem, AnSrtmTile) {
  constexpr std::size_t kSide = 1201;
  std::string tile(kSide * kSide * 2, '\0');
  const auto put = [&](std::size_t row, std::size_t column, std::int16_t height) {
    const auto bits = static_cast<std::uint16_t>(height);
    tile[2 * (row * kSide + column)] = static_cast<char>(bits >> 8);
    tile[2 * (row * kSide + column) + 1] = static_cast<char>(bits & 0xFF);
  };
  put(kSide - 1, 5, 1234);
  put(3, 4, -32768);
  const auto model = test::value_of(read(tile, "N46E007.hgt"));
  EXPECT_EQ(model.file_points, kSide * kSide);
  EXPECT_EQ(model.non_finite, 1u);
  EXPECT_NEAR(model.cloud.point_mm(5).z(), 1234e3, 1.0);
  EXPECT_TRUE(warns(model, "46.5"));
  EXPECT_FALSE(read(tile.substr(1), "N46E007.hgt"));
}

// Lies.

TEST(Dem, HeadersThatLieAreErrors) {
  std::string png = written("PNG", "a.png", 50, 20, ramp(50, 20), GDT_UInt16);
  png[16] = png[20] = '\x7F';
  const struct {
    std::string content, name, says;
  } lies[] = {
      {"ncols 6000\nnrows 6000\ncellsize 1\n1 2 3", "a.asc", "promises"},
      {"ncols -3\nnrows 3\n1 2 3", "a.asc", "ncols"},
      {png, "a.png", "promises"},
      {"hello", "a.png", ""},
      {"hello", "a.tif", ""},
      {"hello", "a.hgt", ""},
      {"hello", "a.dem", ""},
      {"PK\x03\x04 and no more", "a.hgt.zip", ""},
      // No network, no other drivers: a description of a remote file is no raster of ours.
      {"<GDAL_WMS><Service name=\"TMS\"><ServerUrl>http://localhost/</ServerUrl></Service></GDAL_WMS>",
       "a.tif", ""}};
  for (const auto& lie : lies) {
    const auto model = read(lie.content, lie.name);
    ASSERT_TRUE(test::refused(model, lie.says)) << lie.name;
    EXPECT_EQ(model.error().file, lie.name);
    EXPECT_FALSE(model.error().remedy.empty());
  }
}

TEST(Dem, AnyCutOrFlippedByteIsAnErrorOrAModel) {
  Random random(11);
  const std::vector<std::pair<std::string, std::string>> files = {
      {written("GTiff", "a.tif", 40, 30, ramp(40, 30), GDT_UInt16, 25.0), "a.tif"},
      {written("PNG", "a.png", 40, 30, ramp(40, 30), GDT_UInt16), "a.png"},
      {esri("1 2 3\n4 5 6\n"), "a.asc"}};
  io::ReadOptions options;
  options.max_bytes = std::uint64_t{1} << 22;
  for (const auto& [content, name] : files) {
    for (int i = 0; i < 300; ++i) {
      std::string bad = content;
      const auto at = static_cast<std::size_t>(
          random.uniform(0.0, static_cast<double>(std::min<std::size_t>(bad.size(), 600))));
      if (i % 3 == 0)
        bad.resize(at);
      else
        bad[at] = static_cast<char>(static_cast<unsigned char>(random.below(256)));
      const auto model = read(bad, name, options);
      EXPECT_TRUE(model ? model->cloud.size() * sizeof(Vec3) <= options.max_bytes
                        : !model.error().what.empty());
    }
  }
}

TEST(DemCheck, PostsPerByteHaveABound) {
  EXPECT_TRUE(check_size(DemFormat::kEsriAscii, 10, 10, 200, {}));
  EXPECT_FALSE(check_size(DemFormat::kEsriAscii, 10, 10, 150, {}));
  EXPECT_FALSE(check_size(DemFormat::kTiff, std::uint64_t{1} << 40, std::uint64_t{1} << 40, 1 << 30, {}));
  EXPECT_FALSE(check_size(DemFormat::kTiff, 100000, 100000, 1 << 30, {}));  // 240 GB of points
  EXPECT_FALSE(check_size(DemFormat::kTiff, 0, 5, 100, {}));
  EXPECT_FALSE(check_size(DemFormat::kTiff, 1, 5, 100, {}));
}

// Real tiles.

TEST(Dem, RealTiles) {
  if (shared_data("dem").empty()) GTEST_SKIP() << "no folder dem in PALPATE_DATA";
  struct Tile {
    const char* file;
    std::size_t posts;
    double low_m, high_m;
  };
  io::Readers readers;
  io::add_standard_readers(readers);
  add_dem_readers(readers);
  for (const Tile& tile :
       {Tile{"SainteHelens.asc.xz", 327 * 468, 600, 2600}, Tile{"SainteHelens.dem.xz", 327 * 468, 600, 2600},
        Tile{"N42E001.hgt.zip", 1201 * 1201, 0, 3500}, Tile{"S29W072.hgt.zip", 1201 * 1201, -100, 3500}}) {
    const std::string file = shared_data(std::string("dem/") + tile.file).string();
    if (file.empty()) continue;
    const auto model = test::value_of(readers.read(file, {}));
    EXPECT_EQ(model.file_points, tile.posts) << tile.file;
    const geometry::Aabb box = model.cloud.box_mm();
    EXPECT_GT(box.low_mm.z(), 1000 * tile.low_m) << tile.file;
    EXPECT_LT(box.high_mm.z(), 1000 * tile.high_m) << tile.file;
    const auto field = test::value_of(cloud::height_field_of(model.cloud));
    // A lattice of holes at the rim may be smaller than the file's.
    EXPECT_EQ(field.posts() - field.holes, model.cloud.size());
  }
}

}  // namespace
}  // namespace palpate::dem
