// PCD files through PCL: every storage gives the same points; bad ones give an Error and no output.
#include <palpate/read_model.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <span>

#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"
#include "toolkit/io/byte_source.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"

namespace palpate::pcd {
namespace {

constexpr std::uint64_t kSeed = 77;
constexpr std::uint32_t kWidth = 20;
constexpr std::uint32_t kHeight = 15;

Result<io::ReadModel> read(const std::string& content, const io::ReadOptions& options = {}) {
  io::Readers readers;
  add_pcd_reader(readers);
  return readers.read(std::make_unique<io::MemorySource>(std::as_bytes(std::span(content))), "a.pcd",
                      options);
}

std::string header(const std::string& data, std::uint32_t width = kWidth, std::uint32_t height = kHeight) {
  return "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgba intensity\nSIZE 4 4 4 4 "
         "4\n"
         "TYPE F F F U F\nCOUNT 1 1 1 1 1\nWIDTH " +
         std::to_string(width) + "\nHEIGHT " + std::to_string(height) + "\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " +
         std::to_string(width * height) + "\nDATA " + data + "\n";
}

struct Row {
  float x, y, z;
  std::uint32_t rgba;
  float intensity;
};

std::vector<Row> make_rows() {
  Random random(kSeed);
  std::vector<Row> rows;
  for (std::uint32_t i = 0; i < kWidth * kHeight; ++i)
    rows.push_back({static_cast<float>(random.uniform(-1, 1)), static_cast<float>(random.uniform(-1, 1)),
                    static_cast<float>(random.uniform(1, 2)), i, static_cast<float>(random.uniform())});
  return rows;
}

std::string bytes_of(const void* from, std::size_t size) {
  return {static_cast<const char*>(from), size};
}

std::string ascii(const std::vector<Row>& rows) {
  std::string out = header("ascii");
  char line[160];
  for (const Row& row : rows) {
    std::snprintf(line, sizeof line, "%.9g %.9g %.9g %u %.9g\n", static_cast<double>(row.x),
                  static_cast<double>(row.y), static_cast<double>(row.z), row.rgba,
                  static_cast<double>(row.intensity));
    out += line;
  }
  return out;
}

std::string binary(const std::vector<Row>& rows) {
  return header("binary") + bytes_of(rows.data(), rows.size() * sizeof(Row));
}

// LZF with literal runs only, which is valid LZF.
std::string compressed(const std::vector<Row>& rows) {
  std::string columns;
  for (std::size_t at = 0; at < sizeof(Row); at += sizeof(float)) {
    for (const Row& row : rows) columns += bytes_of(reinterpret_cast<const char*>(&row) + at, sizeof(float));
  }
  std::string packed;
  constexpr std::size_t kRun = 32;
  for (std::size_t i = 0; i < columns.size(); i += kRun) {
    const std::string run = columns.substr(i, kRun);
    packed += static_cast<char>(run.size() - 1);
    packed += run;
  }
  const auto packed_size = static_cast<std::uint32_t>(packed.size()),
             size = static_cast<std::uint32_t>(columns.size());
  return header("binary_compressed") + bytes_of(&packed_size, sizeof packed_size) +
         bytes_of(&size, sizeof size) + packed;
}

TEST(Pcd, EveryStorageGivesTheSamePoints) {
  const std::vector<Row> rows = make_rows();
  for (const std::string& content : {ascii(rows), binary(rows), compressed(rows)}) {
    SCOPED_TRACE(kSeed);
    const auto model = test::value_of(read(content));
    SCOPED_TRACE(model.format);
    ASSERT_EQ(model.cloud.size(), rows.size());
    ASSERT_TRUE(model.cloud.raster);
    EXPECT_EQ(model.cloud.raster->columns, kWidth);
    EXPECT_EQ(model.cloud.raster->rows, kHeight);
    EXPECT_EQ(model.unit, io::Unit::kMetre);
    EXPECT_TRUE(model.unit_guessed);
    ASSERT_EQ(model.cloud.properties.size(), 1u);  // the packed colour is no number
    EXPECT_EQ(model.cloud.properties[0].name, "intensity");
    for (std::size_t i = 0; i < rows.size(); ++i) {
      EXPECT_NEAR(model.cloud.point_mm(i).x(), 1000.0 * static_cast<double>(rows[i].x), 1e-3);
      EXPECT_NEAR(model.cloud.point_mm(i).z(), 1000.0 * static_cast<double>(rows[i].z), 1e-3);
      EXPECT_EQ(model.cloud.properties[0].values[i], rows[i].intensity);
    }
  }
  EXPECT_EQ(read(binary(rows))->content_hash, read(compressed(rows))->content_hash);
  EXPECT_EQ(read(binary(rows))->content_hash, read(ascii(rows))->content_hash);
}

/// What is left of a raster with points that are not finite says where it was taken: its triangles are read.
TEST(Pcd, ARasterWithHolesIsReadIntoStars) {
  std::vector<Row> rows = make_rows();
  for (std::uint32_t i = 0; i < rows.size(); ++i) {
    rows[i].x = 0.001F * static_cast<float>(i % kWidth);
    rows[i].y = 0.001F * static_cast<float>(i / kWidth);
    rows[i].z = 1.0F + 0.05F * rows[i].x;
  }
  for (const std::size_t missing : {3u, 110u, 111u}) rows[missing].z = std::nanf("");
  const auto model = test::value_of(read(ascii(rows)));
  const local_delaunay::LocalDelaunayMesh mesh = local_delaunay::LocalDelaunayMesh::build(model.cloud, 2);
  EXPECT_EQ(mesh.counts().raster_points, rows.size() - 3);
  EXPECT_EQ(mesh.counts().pieces, 1u);
  EXPECT_EQ(mesh.counts().unused, 0u);
  // Two triangles a cell; a missing point takes six along at most, and each hole is filled but at the border.
  constexpr std::uint64_t kWhole = 2u * (kWidth - 1) * (kHeight - 1);
  EXPECT_LT(mesh.counts().triangles, kWhole);
  EXPECT_GE(mesh.counts().triangles, kWhole - 3u * 4u);
}

TEST(Pcd, HolesAreDroppedAndTheRasterWithThem) {
  std::vector<Row> rows = make_rows();
  rows[3].x = std::nanf("");
  rows[100].z = std::nanf("");
  for (const std::string& content : {ascii(rows), binary(rows), compressed(rows)}) {
    const auto model = test::value_of(read(content));
    EXPECT_EQ(model.non_finite, 2u);
    EXPECT_EQ(model.cloud.size(), rows.size() - 2);
    EXPECT_FALSE(model.cloud.raster);
    EXPECT_EQ(model.cloud.properties[0].values[3], rows[4].intensity);
    ASSERT_EQ(model.cloud.properties.size(), 3u);
    for (std::size_t i = 0; i < model.cloud.size(); ++i) {
      const std::size_t in_file = i + (i >= 3 ? 1 : 0) + (i >= 99 ? 1 : 0);
      EXPECT_EQ(model.cloud.properties[1].values[i], static_cast<float>(in_file / kWidth));
      EXPECT_EQ(model.cloud.properties[2].values[i], static_cast<float>(in_file % kWidth));
    }
  }
  io::ReadOptions refuse;
  refuse.non_finite = cloud::NonFinite::kRefuse;
  EXPECT_FALSE(read(binary(rows), refuse));
}

TEST(Pcd, WideFieldsAndPadding) {
  const std::string text =
      "VERSION 0.7\nFIELDS x _ y z label\nSIZE 8 1 8 8 2\nTYPE F U F F I\nCOUNT 1 3 1 1 1\nWIDTH 1\nHEIGHT "
      "1\n"
      "POINTS 1\nDATA binary\n";
  const double x = 500000.25, y = -5400000.125, z = 3;
  const std::int16_t label = -7;
  const auto model = test::value_of(
      read(text + bytes_of(&x, 8) + "pad" + bytes_of(&y, 8) + bytes_of(&z, 8) + bytes_of(&label, 2)));
  EXPECT_EQ(model.cloud.point_mm(0), Vec3(1000 * x, 1000 * y, 1000 * z));
  ASSERT_EQ(model.cloud.properties.size(), 1u);
  EXPECT_EQ(model.cloud.properties[0].values[0], -7.0F);
}

TEST(Pcd, FieldsOfNoValuesAndLinesThatEndInCarriageReturns) {
  const std::string head =
      "VERSION 0.7\nFIELDS x _ y z\nSIZE 4 1 4 4\nTYPE F U F F\nCOUNT 1 0 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\n";
  std::string text = head + "DATA ascii\n1 2 3\n4 5 6\n", binary = head + "DATA binary\n";
  for (const float value : {1.0F, 2.0F, 3.0F, 4.0F, 5.0F, 6.0F}) binary += bytes_of(&value, sizeof value);
  std::string carriage = text;
  std::replace(carriage.begin(), carriage.end(), '\n', '\r');
  for (const std::string& content : {text, binary, carriage}) {
    const auto model = test::value_of(read(content));
    ASSERT_EQ(model.cloud.size(), 2u);
    EXPECT_EQ(model.cloud.point_mm(1), Vec3(4000, 5000, 6000));
    EXPECT_TRUE(model.cloud.properties.empty());
  }
  EXPECT_TRUE(
      test::refused(read(head + "DATA ascii\n1,5 2 3\n4 5 6\n"), "decimal points, not decimal commas"));
}

TEST(Pcd, BadFilesGiveAnErrorAndNoOutput) {
  testing::internal::CaptureStderr();
  testing::internal::CaptureStdout();
  std::size_t files = 0, models = 0;
  for (const auto& entry : std::filesystem::directory_iterator(PALPATE_CORPUS)) {
    const Result<io::ReadModel> model = read(file_text(entry.path()));
    ++files;
    models += model.ok();
    EXPECT_TRUE(model || (!model.error().what.empty() && model.error().file == "a.pcd")) << entry.path();
  }
  // Compressed bytes that are none pass our check and must stop inside PCL.
  std::string damaged = compressed(make_rows());
  for (std::size_t i = damaged.size() - 400; i < damaged.size(); ++i) damaged[i] = static_cast<char>(0xFF);
  EXPECT_FALSE(read(damaged));
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_GE(files, 10u);
  EXPECT_GE(models, 4u);
}

TEST(Pcd, RealScans) {
  struct Scan {
    const char* file;
    std::size_t points, non_finite;
  };
  io::Readers readers;
  add_pcd_reader(readers);
  std::size_t found = 0;
  for (const Scan& scan : {Scan{"CSite1_red1-utm.pcd", 522674, 0}, Scan{"capture0001.pcd", 307200, 57553},
                           Scan{"capture0002.pcd", 307200, 57269}, Scan{"capture0003.pcd", 307200, 58706},
                           Scan{"capture0004.pcd", 307200, 62627}, Scan{"capture0005.pcd", 307200, 62223},
                           Scan{"milk_cartoon_all_small_clorox.pcd", 307200, 65793},
                           Scan{"room_scan1.pcd", 112586, 0}, Scan{"samp11-utm.pcd", 38010, 0}}) {
    const std::filesystem::path path = shared_data(std::string("pcl/") + scan.file);
    if (path.empty()) continue;
    ++found;
    SCOPED_TRACE(scan.file);
    const auto model = test::value_of(readers.read(path.string(), {}));
    EXPECT_EQ(model.file_points, scan.points);
    EXPECT_EQ(model.non_finite, scan.non_finite);
    EXPECT_EQ(model.cloud.size(), scan.points - scan.non_finite);
  }
  if (found == 0) GTEST_SKIP() << "none of the scans is under PALPATE_DATA";
}

}  // namespace
}  // namespace palpate::pcd
