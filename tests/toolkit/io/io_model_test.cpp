// What happens between a format and the model: units, points that are not finite, far coordinates, writing.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <bit>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <memory>
#include <span>
#include <tuple>

#include <palpate/read_model.h>
#include "compress.h"
#include "tests/toolkit/messages.h"
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"

namespace palpate::io {
namespace {

std::string temporary(const std::string& name) {
  return (std::filesystem::path(testing::TempDir()) / fmt::format("palpate_{}_{}", getpid(), name)).string();
}

TEST(Units, AreParsedAndNamed) {
  EXPECT_EQ(*parse_unit("m"), Unit::kMetre);
  EXPECT_EQ(*parse_unit(" Millimeter "), Unit::kMillimetre);
  EXPECT_EQ(*parse_unit("inches"), Unit::kInch);
  EXPECT_FALSE(parse_unit("furlong"));
  EXPECT_DOUBLE_EQ(mm_per(Unit::kInch), 25.4);
  EXPECT_EQ(unit_name(Unit::kMicrometre), "um");
  for (const Unit unit : {Unit::kMetre, Unit::kCentimetre, Unit::kMillimetre, Unit::kMicrometre, Unit::kInch})
    EXPECT_EQ(*parse_unit(unit_name(unit)), unit);
}

TEST(Units, GuessesSayWhatWhyAndHowToOverride) {
  for (const auto& [text, unit, why] :
       {std::tuple("0 0 0\n0.2 0 0\n", Unit::kMetre, "below 10"),
        {"0 0 0\n200 0 0\n", Unit::kMillimetre, "not below 10"},
        {"500000 5000000 0\n500100 5000000 0\n", Unit::kMetre, "geographic"}}) {
    const ReadModel model = model_of(text, "a.xyz");
    EXPECT_TRUE(model.unit_guessed);
    EXPECT_EQ(model.unit, unit) << text;
    ASSERT_EQ(model.warnings.size(), 1u);
    EXPECT_TRUE(test::contains(model.warnings[0], why, "--unit"));
  }
}

TEST(Units, GivenOnesWinAndScaleMultiplies) {
  ReadOptions options;
  options.unit = Unit::kInch;
  options.scale = 2.0;
  const ReadModel model = model_of("0 0 0\n1 0 0\n", "a.xyz", options);
  EXPECT_FALSE(model.unit_guessed);
  EXPECT_TRUE(model.warnings.empty());
  EXPECT_NEAR(model.cloud.point_mm(1).x(), 50.8, 1e-5);  // a float's rounding over 50 mm
  for (const double scale : {0.0, -1.0, std::nan(""), HUGE_VAL}) {
    options.scale = scale;
    EXPECT_FALSE(read_text("0 0 0\n1 0 0\n", "a.xyz", options));
  }
}

TEST(NonFinitePoints, AreDroppedCountedAndTakenOutOfFaces) {
  const std::string text =
      "ply\nformat ascii 1.0\ncomment unit mm\nobj_info num_cols 3\nobj_info num_rows 2\nelement vertex 6\n"
      "property float x\nproperty float y\nproperty float z\nproperty int id\nelement face 4\n"
      "property list uchar int vertex_indices\nend_header\n"
      "0 0 0 10\nnan 0 0 11\n1 0 0 12\n0 1 0 13\n0 -1.#IND 0 14\n0 0 1 15\n"
      "3 0 2 3\n3 0 1 2\n4 0 2 3 5\n4 5 3 2 4\n";
  const ReadModel model = model_of(text, "a.ply");
  EXPECT_EQ(model.file_points, 6u);
  EXPECT_EQ(model.non_finite, 2u);
  EXPECT_EQ(model.cloud.size(), 4u);
  EXPECT_FALSE(model.cloud.raster);  // its rows have holes now
  ASSERT_EQ(model.cloud.properties.size(), 3u);
  EXPECT_EQ(model.cloud.properties[0].values, (std::vector<float>{10, 12, 13, 15}));
  EXPECT_EQ(model.cloud.properties[1].name, "row");
  EXPECT_EQ(model.cloud.properties[1].values, (std::vector<float>{0, 0, 1, 1}));
  EXPECT_EQ(model.cloud.properties[2].name, "column");
  EXPECT_EQ(model.cloud.properties[2].values, (std::vector<float>{0, 2, 0, 2}));
  ASSERT_NE(model.mesh, nullptr);
  EXPECT_EQ(model.mesh->triangles,
            (std::vector<std::array<std::uint32_t, 3>>{{0, 1, 2}, {0, 1, 2}, {0, 2, 3}}));
  EXPECT_EQ(model.dropped_faces, 2u);
  EXPECT_EQ(model.warnings.size(), 2u);

  ReadOptions refuse;
  refuse.non_finite = cloud::NonFinite::kRefuse;
  EXPECT_TRUE(test::refused(read_text(text, "a.ply", refuse),
                            "2 of 6 points are not finite, the first is point 2", "--non-finite drop"));
}

/// Six points of a raster in cm, with a column; a polygon leads out of the box, and a face nowhere.
constexpr const char* kSixPoints =
    "ply\nformat ascii 1.0\nobj_info num_cols 3\nobj_info num_rows 2\nelement vertex 6\n"
    "property float x\nproperty float y\nproperty float z\nproperty int id\nelement face 4\n"
    "property list uchar int vertex_indices\nend_header\n"
    "0 0 0 10\n1 0 0 11\n2 0 0 12\n0 1 0 13\n1 1 0 14\n2 1 0 15\n"
    "3 0 1 3\n4 1 2 5 4\n3 1 4 3\n3 0 1 9\n";

TEST(Within, KeepsThePointsOfTheClosedBoxWithTheirColumnsAndFaces) {
  ReadOptions options;
  options.unit = Unit::kCentimetre;
  options.scale = 2.0;
  const auto four = geometry::Aabb{{0, 0, 0}, {20, 20, 0}};
  options.within_mm = four;
  const ReadModel model = model_of(kSixPoints, "a.ply", options);
  EXPECT_EQ(model.file_points, 6u);
  EXPECT_EQ(model.outside, 2u);
  EXPECT_EQ(model.non_finite, 0u);
  ASSERT_EQ(model.cloud.size(), 4u);
  EXPECT_FALSE(model.cloud.raster);
  ASSERT_EQ(model.cloud.properties.size(), 3u);
  EXPECT_EQ(model.cloud.properties[0].values, (std::vector<float>{10, 11, 13, 14}));
  EXPECT_EQ(model.cloud.properties[1].values, (std::vector<float>{0, 0, 1, 1})) << "row";
  EXPECT_EQ(model.cloud.properties[2].values, (std::vector<float>{0, 1, 0, 1})) << "column";
  ASSERT_NE(model.mesh, nullptr);
  EXPECT_EQ(model.mesh->vertices_mm.size(), 4u);
  EXPECT_EQ(model.mesh->triangles, (std::vector<std::array<std::uint32_t, 3>>{{0, 1, 2}, {1, 3, 2}}));
  EXPECT_EQ(model.dropped_faces, 1u) << "the one that leads nowhere; those at the border are no fault";
  ReadOptions in_mm;
  in_mm.unit = Unit::kMillimetre;
  EXPECT_EQ(model.content_hash, model_of("0 0 0\n20 0 0\n0 20 0\n20 20 0\n", "a.xyz", in_mm).content_hash);
  options.within_mm = geometry::Aabb{{0, 0, 0}, {40, 20, 0}};
  EXPECT_TRUE(model_of(kSixPoints, "a.ply", options).cloud.raster) << "nothing is cut off";
}

TEST(Within, PointsThatAreNotFiniteAreCountedApart) {
  ReadOptions options;
  options.unit = Unit::kMillimetre;
  options.within_mm = geometry::Aabb{{-1, -1, -1}, {1, 1, 1}};
  const ReadModel model = model_of("5 0 0\nnan 0 0\n0 0.5 0\n1 1 1\n", "a.xyz", options);
  EXPECT_EQ(model.outside, 1u);
  EXPECT_EQ(model.non_finite, 1u);
  ASSERT_EQ(model.cloud.size(), 2u);
  EXPECT_EQ(model.cloud.point_mm(1), Vec3(1, 1, 1));
}

TEST(Within, BoxesThatAreNoneOrHoldNothingAreRefused) {
  ReadOptions options;
  options.unit = Unit::kCentimetre;
  options.within_mm = geometry::Aabb{{7, 7, 7}, {8, 8, 8}};
  EXPECT_TRUE(test::refused(read_text(kSixPoints, "a.ply", options), "a.ply: no point is within (7, 7, 7)",
                            "the points are within (0, 0, 0) to (20, 10, 0) mm"));
  for (const geometry::Aabb& box :
       {geometry::Aabb{{0, 0, 2}, {9, 9, 1}}, geometry::Aabb{},
        geometry::Aabb{{0, std::nan(""), 0}, {9, 9, 9}}, geometry::Aabb{{0, 0, 0}, {9, HUGE_VAL, 9}}}) {
    options.within_mm = box;
    EXPECT_TRUE(test::refused(read_text(kSixPoints, "a.ply", options), "is no box", "its low corner"));
  }
}

using Values = std::vector<float>;

/// The model's properties are these rows and columns, and no more.
void expect_positions(const ReadModel& model, const Values& rows, const Values& columns) {
  ASSERT_EQ(model.cloud.properties.size(), 2u);
  EXPECT_EQ(model.cloud.properties[0].name, "row");
  EXPECT_EQ(model.cloud.properties[0].values, rows);
  EXPECT_EQ(model.cloud.properties[1].name, "column");
  EXPECT_EQ(model.cloud.properties[1].values, columns);
}

/// A scan of three columns and two rows, of which some positions saw nothing.
std::string range_grid(const std::string& vertices, const std::string& cells) {
  const auto lines = [](const std::string& text) { return std::count(text.begin(), text.end(), '\n'); };
  return fmt::format(
      "ply\nformat ascii 1.0\ncomment unit mm\nobj_info num_cols 3\nobj_info num_rows 2\nelement vertex {}\n"
      "property float x\nproperty float y\nproperty float z\nelement range_grid {}\n"
      "property list uchar int vertex_indices\nend_header\n{}{}",
      lines(vertices), lines(cells), vertices, cells);
}

TEST(RangeGrids, SayEachPointsRowAndColumn) {
  const std::string four = "0 0 0\n2 0 0\n1 1 0\n2 1 0\n";
  const ReadModel model = model_of(range_grid(four, "1 0\n0\n1 1\n0\n1 2\n1 3\n"), "a.ply");
  EXPECT_FALSE(model.cloud.raster);
  expect_positions(model, {0, 0, 1, 1}, {0, 2, 1, 2});
  EXPECT_TRUE(model.warnings.empty());
}

TEST(RangeGrids, HoldWhereAPointIsDroppedAndInAnyOrder) {
  const std::string text = range_grid("2 0 0\nnan 0 0\n1 1 0\n2 1 0\n", "1 2\n0\n1 1\n0\n1 3\n1 0\n");
  expect_positions(model_of(text, "a.ply"), {1, 0, 1}, {2, 0, 1});
}

TEST(RangeGrids, WithoutHolesAreARaster) {
  const std::string six = "0 0 0\n1 0 0\n2 0 0\n0 1 0\n1 1 0\n2 1 0\n";
  const ReadModel model = model_of(range_grid(six, "1 0\n1 1\n1 2\n1 3\n1 4\n1 5\n"), "a.ply");
  ASSERT_TRUE(model.cloud.raster);
  EXPECT_EQ(model.cloud.raster->columns, 3u);
  EXPECT_EQ(model.cloud.raster->rows, 2u);
  EXPECT_TRUE(model.cloud.properties.empty());
}

TEST(RangeGrids, ThatDoNotListEveryPointOnceAreWarnedOf) {
  const std::string three = "0 0 0\n2 0 0\n1 1 0\n";
  for (const char* cells :
       {"1 0\n0\n1 1\n0\n0\n0\n", "1 0\n1 2\n1 1\n0\n1 2\n0\n", "2 0 1\n1 2\n0\n0\n0\n0\n",
        "1 0\n1 3\n1 1\n1 2\n0\n0\n", "1 0\n1 -1\n1 1\n1 2\n0\n0\n"}) {
    const ReadModel model = model_of(range_grid(three, cells), "a.ply");
    EXPECT_EQ(model.cloud.size(), 3u) << cells;
    EXPECT_TRUE(model.cloud.properties.empty()) << cells;
    ASSERT_EQ(model.warnings.size(), 1u) << cells;
    EXPECT_TRUE(test::contains(model.warnings[0], "does not list every point once"));
  }
  // One position short of what the header says: not a raster's grid, and passed over.
  const ReadModel short_of_one = model_of(range_grid(three, "1 0\n1 1\n1 2\n0\n0\n"), "a.ply");
  EXPECT_TRUE(short_of_one.cloud.properties.empty());
  EXPECT_TRUE(short_of_one.warnings.empty());
}

TEST(RangeGrids, ThatAreCutOffAreRefused) {
  const std::string whole = range_grid("0 0 0\n2 0 0\n", "1 0\n0\n1 1\n0\n0\n0\n");
  EXPECT_FALSE(read_text(whole.substr(0, whole.size() - 4), "a.ply"));
}

TEST(FarClouds, KeepTheirDetailInDoublePly) {
  std::string text =
      "ply\nformat ascii 1.0\nelement vertex 1000\nproperty double x\nproperty double y\nproperty double "
      "z\nend_header\n";
  for (int i = 0; i < 1000; ++i)
    text += fmt::format("{:.4f} {:.4f} {}\n", 515369 + 0.0001 * i, 4918340 + 0.0002 * i, 2.5);
  const ReadModel model = model_of(text, "utm.ply");
  ASSERT_EQ(model.unit, Unit::kMetre);
  // A tenth of a millimetre at 4,918 km: float alone would keep half a metre. What is left is the double's
  // own ulp, 2^-20 mm at 5e9 mm, and the float's half ulp over a box of 200 mm, 2^-18 mm.
  EXPECT_LT(model.max_rounding_mm, 1e-5);
  for (std::size_t i = 1; i < 1000; ++i) {
    EXPECT_NEAR(model.cloud.point_mm(i).x() - model.cloud.point_mm(i - 1).x(), 0.1, 1e-5);
    EXPECT_NEAR(model.cloud.point_mm(i).y() - model.cloud.point_mm(i - 1).y(), 0.2, 1e-5);
  }
}

TEST(Numbers, AreReadAsTheWorldWritesThem) {
  const std::pair<std::string, double> numbers[] = {{"+1.5", 1.5},
                                                    {"-1.5e-3", -0.0015},
                                                    {"1e999", HUGE_VAL},
                                                    {"-1e999", -HUGE_VAL},
                                                    {"1e-999", 0.0},
                                                    {"0." + std::string(400, '0') + "1", 0.0},
                                                    {std::string(400, '7'), HUGE_VAL},
                                                    {"-1.#INF", -HUGE_VAL}};
  for (const auto& [text, number] : numbers) EXPECT_EQ(parse_real(text), number) << text;
  for (const char* text : {"NaN", "-nan", "1.#QNAN"})
    EXPECT_TRUE(std::isnan(parse_real(text).value_or(0))) << text;
  for (const char* bad : {"", "+", "-", "+-1", "1,5", "0x10", "1.5.2", "1e", "abc", "1.#"})
    EXPECT_FALSE(parse_real(bad)) << bad;
  EXPECT_EQ(parse_whole("+12"), 12);
  EXPECT_FALSE(parse_whole("99999999999999999999"));
  EXPECT_EQ(to_float(1e300), HUGE_VALF);
}

TEST(Writing, ACloudComesBackAsItWas) {
  auto first = test::value_of(
      read_text("x,y,z,friction rate\n1.25,2,3,0.5\n4,5,6,0.25\n7,8,9,\n1e-3,0,0,1\n", "a.csv"));
  first.cloud.raster = cloud::ScanRaster{2, 2};
  const std::string path = temporary("cloud.ply");
  ASSERT_TRUE(write_cloud_ply(path, first.cloud));
  Readers readers;
  add_standard_readers(readers);
  const auto second = test::value_of(readers.read(path, {}));
  std::filesystem::remove(path);
  EXPECT_EQ(second.unit, Unit::kMillimetre);
  EXPECT_FALSE(second.unit_guessed);
  EXPECT_EQ(second.cloud.x_mm, first.cloud.x_mm);
  EXPECT_EQ(second.cloud.y_mm, first.cloud.y_mm);
  EXPECT_EQ(second.cloud.z_mm, first.cloud.z_mm);
  ASSERT_EQ(second.cloud.properties.size(), 1u);
  EXPECT_EQ(second.cloud.properties[0].name, "friction_rate");
  EXPECT_EQ(second.cloud.properties[0].values[1], 0.25F);
  EXPECT_TRUE(std::isnan(second.cloud.properties[0].values[2]));
  ASSERT_TRUE(second.cloud.raster);
  EXPECT_EQ(second.cloud.raster->columns, 2u);
}

TEST(Writing, AMeshComesBackBitForBitAndLeavesNoPart) {
  geometry::TriangleMesh mesh;
  mesh.vertices_mm = {{0.1, 1e6, -3}, {1.0 / 3.0, 0, 5}, {4, 5, 6}, {7, 8, 9.25}};
  mesh.triangles = {{0, 1, 2}, {3, 2, 1}};
  const std::string path = temporary("mesh.ply");
  ASSERT_TRUE(write_mesh_ply(path, mesh));
  EXPECT_FALSE(std::filesystem::exists(path + ".part"));
  Readers readers;
  add_standard_readers(readers);
  const auto back = test::value_of(readers.read(path, {}));
  std::filesystem::remove(path);
  ASSERT_NE(back.mesh, nullptr);
  EXPECT_EQ(back.mesh->vertices_mm, mesh.vertices_mm);
  EXPECT_EQ(back.mesh->triangles, mesh.triangles);
  EXPECT_FALSE(write_mesh_ply(path + "/not/there.ply", mesh));
}

TEST(Progressing, CanBeStopped) {
  struct StopAtOnce final : Progress {
    void report(std::string_view, double fraction) override { last = fraction; }
    [[nodiscard]] bool cancelled() const override { return true; }
    double last = -1.0;
  } stop;
  std::string text;
  for (int i = 0; i < 100000; ++i) text += "1 2 3\n";
  Readers readers;
  add_standard_readers(readers);
  EXPECT_TRUE(test::refused(
      readers.read(std::make_unique<MemorySource>(std::as_bytes(std::span(text))), "a.xyz", {}, stop),
      "stopped"));
  EXPECT_GT(stop.last, 0.0);
  EXPECT_LE(stop.last, 1.0);
}

// PFM height maps: both byte orders, their scale, lies.

Result<ReadModel> read(const std::string& content, const ReadOptions& options = {}) {
  return read_text(content, "a.pfm", options);
}

std::string floats(const std::vector<float>& values, bool little) {
  std::string bytes;
  for (const float value : values) {
    const auto bits = std::bit_cast<std::uint32_t>(value);
    for (int i = 0; i < 4; ++i) bytes += static_cast<char>(bits >> 8 * (little ? i : 3 - i) & 0xFF);
  }
  return bytes;
}

TEST(Pfm, BothByteOrdersFromTheBottomUp) {
  const std::vector<float> heights = {1, 2, 3, 4, 5, 6.5f};
  for (const bool little : {true, false}) {
    const ReadModel model = model_of(
        std::string("Pf\n3 2\n") + (little ? "-1.0" : "1.0") + "\n" + floats(heights, little), "a.pfm");
    ASSERT_TRUE(model.cloud.raster);
    EXPECT_EQ(model.cloud.raster->columns, 3u);
    EXPECT_EQ(model.cloud.point_mm(0), Vec3(0, 0, 1));
    EXPECT_EQ(model.cloud.point_mm(5), Vec3(2, 1, 6.5));
  }
}

TEST(Pfm, SpacingAndVerticalScaleInMm) {
  ReadOptions options;
  options.post_mm = 0.5;
  options.vertical_mm = 0.125;
  const ReadModel model = model_of("Pf 2 2 -1\n" + floats({1, 2, 3, 4}, true), "a.pfm", options);
  EXPECT_EQ(model.cloud.point_mm(3), Vec3(0.5, 0.5, 0.5));
}

// A file without a tag, with a value for "no data" among heights of 100 to 115.
TEST(Pfm, NumbersThatLookLikeNoDataAreWarnedOfAndLeftOut) {
  const auto grid_with = [](float number, int count) {
    std::vector<float> heights;
    for (int i = 0; i < 16; ++i) heights.push_back(i < count ? number : 100.0f + static_cast<float>(i));
    return "Pf 4 4 -1\n" + floats(heights, true);
  };
  // What is said of `--no-data`, as a warning or, where the largest float is no place at all, in the refusal.
  const auto said = [](const Result<ReadModel>& model) {
    if (!model) return model.error().message();
    for (const std::string& warning : model->warnings)
      if (warning.find("--no-data") != std::string::npos) return warning;
    return std::string();
  };
  for (const float number : {-32768.0f, -9999.0f, -3.4028235e38f, 65535.0f, 0.0f}) {
    SCOPED_TRACE(number);
    ReadOptions options;
    EXPECT_TRUE(test::contains(said(read(grid_with(number, 5))), "5 of 16 posts hold"));
    options.unit = Unit::kMetre;
    EXPECT_TRUE(test::contains(said(read(grid_with(number, 5), options)), "5 of 16 posts hold"));
    options.no_data = number;
    const auto without = read(grid_with(number, 5), options);
    ASSERT_EQ(said(without), "");
    EXPECT_EQ(without->non_finite, 5u);
    EXPECT_EQ(without->cloud.size(), 11u);
  }
  for (const auto& [number, count] : {std::pair(-9999.0f, 1), {-17.0f, 5}, {99.0f, 5}}) {
    // A spike; no customary number; no distance.
    EXPECT_EQ(said(read(grid_with(number, count))), "") << number;
  }
}

TEST(Pfm, HolesAndScalesAreTold) {
  const ReadModel model = model_of("Pf\n2 2\n-3\n" + floats({1, std::nanf(""), 3, 4}, true), "a.pfm");
  EXPECT_EQ(model.non_finite, 1u);
  EXPECT_FALSE(model.cloud.raster);
  ASSERT_FALSE(model.warnings.empty());
  EXPECT_TRUE(test::contains(model.warnings.front(), "scale of 3"));
}

TEST(Pfm, LiesAreErrors) {
  const std::string four = floats({1, 2, 3, 4}, true);
  for (const std::string& content : {std::string("Pf\n2 3\n-1\n") + four, "Pf\n2 2\n0\n" + four,
                                     "Pf\n2 2\nnan\n" + four, "PF\n2 2\n-1\n" + four, "P5\n2 2\n-1\n" + four,
                                     std::string("Pf\n2 2\n"), std::string("Pf\n-2 2\n-1\n") + four,
                                     "Pf\n1 4\n-1\n" + four, "Pf\n4294967296 4294967296\n-1\n" + four,
                                     "Pf\n2 2 -1 9\n" + four, "Pf\n1000000 1000000\n-1\n" + four}) {
    const auto model = read(content);
    ASSERT_FALSE(model) << content;
    EXPECT_FALSE(model.error().remedy.empty()) << model.error().message();
  }
  EXPECT_TRUE(test::refused(read("Pf\n2 3\n-1\n" + four), "2 rows"));
}

}  // namespace
}  // namespace palpate::io
