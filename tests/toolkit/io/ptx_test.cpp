// PTX and PTS, the text of terrestrial scanners: grids, poses, blocks, holes, and files that are damaged.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>
#include <tuple>

#include "compress.h"
#include "e57_writer.h"
#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/files.h"
#include "toolkit/io/point_stream.h"
#include "toolkit/io/read_ptx.h"

namespace palpate::io {
namespace {

const std::string kUnitPose = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
// A quarter turn about z takes x to y; then comes the way to (100, 200, 300). Points are rows before
// matrices.
const std::string kTurned = "100 200 300\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n100 200 300 1\n";

TEST(Ptx, OneScanWithoutHolesIsARaster) {
  std::string text = "3\n2\n" + kUnitPose;
  for (int column = 0; column < 3; ++column)
    for (int row = 0; row < 2; ++row)
      text += fmt::format("{} {} 5 0.25 {} 2 3\n", column + 1, row + 1, 10 * column);
  const DecodedFile decoded = test::value_of(decode(read_ptx, text));
  ASSERT_EQ(decoded.points.size(), 6u);
  ASSERT_TRUE(decoded.raster);
  for (std::size_t column = 0; column < 3; ++column)
    for (std::size_t row = 0; row < 2; ++row)
      EXPECT_EQ(decoded.points[decoded.raster->index(column, row)],
                Vec3(static_cast<double>(column + 1), static_cast<double>(row + 1), 5));
  EXPECT_EQ(decoded.raster->columns, 2u);
  EXPECT_EQ(decoded.raster->rows, 3u);
  EXPECT_TRUE(decoded.position_of.empty());
  EXPECT_EQ(decoded.conventional_unit, Unit::kMetre);
  ASSERT_EQ(decoded.properties.size(), 4u);
  EXPECT_EQ(decoded.properties[0].name, "intensity");
  EXPECT_EQ(decoded.properties[1].name, "red");
  EXPECT_EQ(decoded.properties[0].values, std::vector<float>(6, 0.25F));
  EXPECT_EQ(decoded.properties[1].values[5], 20.0F);
  EXPECT_TRUE(decoded.warnings.empty());
}

TEST(Ptx, HolesKeepThePlacesOfTheRest) {
  const std::string text =
      "2\n3\n" + kTurned + "0 0 0 0.5\n1 2 3 0.1\n0 0 0 0.500000\n4 5 6 0.2\n0 0 0 0\n7 8 9 0.3\n";
  const DecodedFile decoded = test::value_of(decode(read_ptx, text));
  EXPECT_EQ(decoded.points, (std::vector<Vec3>{{98, 201, 303}, {95, 204, 306}, {92, 207, 309}}));
  EXPECT_FALSE(decoded.raster);
  EXPECT_EQ(decoded.position_of, (std::vector<std::uint32_t>{1, 3, 5}));
  EXPECT_EQ(decoded.position_columns, 3u) << "a row of the raster is a column of the file";
  EXPECT_EQ(decoded.properties[0].values, (std::vector<float>{0.1F, 0.2F, 0.3F}));
  ASSERT_EQ(decoded.warnings.size(), 1u);
  EXPECT_TRUE(test::contains(decoded.warnings[0], "3 directions", "holes"));
}

TEST(Ptx, ScansHaveTheirOwnPosesAndColumns) {
  const std::string text = "1\n2\n" + kTurned + "1 0 0 0.5\n0 0 0 0.5\n\n2\n1\n" + kUnitPose +
                           "1 2 3 0.5 7 8 9\r\n4 5 6 0.25 7 8 9\r\n0\n5\n" + kUnitPose;
  const DecodedFile decoded = test::value_of(decode(read_ptx, text));
  EXPECT_EQ(decoded.points, (std::vector<Vec3>{{100, 201, 300}, {1, 2, 3}, {4, 5, 6}}));
  EXPECT_FALSE(decoded.raster);
  EXPECT_TRUE(decoded.position_of.empty());
  ASSERT_EQ(decoded.properties.size(), 4u);
  EXPECT_TRUE(std::isnan(decoded.properties[1].values[0]));
  EXPECT_EQ(decoded.properties[1].values[2], 7.0F);
  for (const std::size_t piece : {std::size_t{1}, std::size_t{2}, std::size_t{99}})
    EXPECT_EQ(test::value_of(stream(ptx_stream, text, piece)), decoded.points);
}

TEST(Pts, ColumnsAreIntensityAndColour) {
  const auto names = [](const std::string& text) {
    std::string all;
    for (const cloud::Property& property : test::value_of(decode(read_pts, text)).properties)
      all += fmt::format("{}={} ", property.name, property.values.at(0));
    return all;
  };
  EXPECT_EQ(names("1\n1 2 3\n"), "");
  EXPECT_EQ(names("1\n1 2 3 -77\n"), "intensity=-77 ");
  EXPECT_EQ(names("1\n1 2 3 -77 8\n"), "intensity=-77 ");
  EXPECT_EQ(names("1\n1 2 3 4 5 6\n"), "red=4 green=5 blue=6 ");
  EXPECT_EQ(names("1\n1 2 3 4 5 6 7\n"), "intensity=4 red=5 green=6 blue=7 ");
  EXPECT_EQ(names("1\n1 2 3 4 5 6 7 0 0 1\n"), "intensity=4 red=5 green=6 blue=7 ");
  const DecodedFile longer = test::value_of(decode(read_pts, "1\n1 2 3 4 5 6 7 0 0 1\n"));
  ASSERT_EQ(longer.warnings.size(), 1u);
  EXPECT_TRUE(test::contains(longer.warnings[0], "10 columns", "passed over"));
}

TEST(Pts, BlocksFollowEachOther) {
  const std::string text = "2\n1 2 3 9\n4 5 6 9\n1\n\n7 8 9 1 2 3 4\n0\n";
  const DecodedFile decoded = test::value_of(decode(read_pts, text));
  EXPECT_EQ(decoded.points, (std::vector<Vec3>{{1, 2, 3}, {4, 5, 6}, {7, 8, 9}}));
  EXPECT_EQ(decoded.conventional_unit, Unit::kMetre);
  EXPECT_TRUE(decoded.warnings.empty());
  EXPECT_EQ(test::value_of(stream(pts_stream, text, 2)), decoded.points);
  // A count that is too small, and none.
  const DecodedFile more = test::value_of(decode(read_pts, "1\n1 2 3\n4 5 6\n7 8 9\n"));
  EXPECT_EQ(more.points.size(), 3u);
  EXPECT_TRUE(test::contains(more.warnings.at(0), "promises 1 points, the file holds 2 more"));
  EXPECT_EQ(test::value_of(stream(pts_stream, "# by a scanner\n1\n1 2 3\n", 2)).size(), 1u);
  EXPECT_EQ(test::value_of(stream(pts_stream, "1 2 3\n4 5 6\n", 1)).size(), 2u);
}

// Columns of text that are only named like a scanner's keep their names, their decimal commas and their unit.
TEST(Pts, OtherColumnsOfTextAreReadAsSuch) {
  const DecodedFile named = test::value_of(decode(read_pts, "# I x(cm) y(cm) z(cm)\n2\n9 1 2 3\n9 4 5 6\n"));
  EXPECT_EQ(named.points, (std::vector<Vec3>{{1, 2, 3}, {4, 5, 6}}));
  EXPECT_EQ(named.unit, Unit::kCentimetre);
  EXPECT_EQ(test::value_of(decode(read_pts, "1 2 3\n4 5 6\n")).points.size(), 2u);
  EXPECT_EQ(test::value_of(decode(read_pts, "1\n1,5 2 3\n")).points[0], Vec3(1.5, 2, 3));
}

class PointFiles : public InFolder {};

TEST_F(PointFiles, StreamsRewindAndErrorsNameTheFile) {
  E57TestFile e57;
  BitStream axes[3];
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const double value : {1.0, 4.0}) axes[axis].put(value + static_cast<double>(axis));
  e57.add({"<cartesianX type=\"Float\"/><cartesianY type=\"Float\"/><cartesianZ type=\"Float\"/>",
           {data_packet({axes[0].bytes(), axes[1].bytes(), axes[2].bytes()})},
           2});
  std::string damaged = e57.bytes();
  damaged[100] = static_cast<char>(damaged[100] ^ 1);
  const std::pair<const char*, std::string> files[] = {
      {"a.e57", e57.bytes()},
      {"a.ptx", "1\n2\n" + kUnitPose + "1 2 3 0.5\n4 5 6 0.5\n"},
      {"a.pts", "2\n1 2 3\n4 5 6\n"}};
  for (const auto& [name, content] : files) {
    SCOPED_TRACE(name);
    ASSERT_TRUE(write_file(in(name), content));
    const auto points = test::value_of(open_point_stream(in(name), 1));
    EXPECT_EQ(points->header().points, 2u);
    std::vector<Vec3> one(1), all(9);
    for (int round = 0; round < 2; ++round) {
      EXPECT_EQ(test::value_of(points->read(one)), 1u);
      EXPECT_EQ(one[0], Vec3(1, 2, 3));
      ASSERT_TRUE(points->rewind());
      EXPECT_EQ(test::value_of(points->read(all)), 2u);
      EXPECT_EQ(all[1], Vec3(4, 5, 6));
      EXPECT_EQ(test::value_of(points->read(all)), 0u);
      ASSERT_TRUE(points->rewind());
    }
    EXPECT_EQ(test::value_of(points->read({})), 0u);
  }
  ASSERT_TRUE(write_file(in("short.pts"), "2\n1 2 3\n"));
  ASSERT_TRUE(write_file(in("damaged.e57"), damaged));
  std::vector<Vec3> all(9);
  EXPECT_TRUE(test::refused(test::value_of(open_point_stream(in("short.pts"), 1))->read(all), "short.pts:2",
                            "promises 2 points", "holds 1"));
  EXPECT_TRUE(test::refused(open_point_stream(in("damaged.e57"), 1), "damaged.e57", "checksum of page 1"));
  EXPECT_TRUE(test::refused(open_point_stream(in("missing.ptx"), 1), "missing.ptx"));
}

TEST(ScanText, FormatsAreToldByTheirFirstLines) {
  const std::string ptx = "3\n2\n" + kUnitPose, pts = "2\n1 2 3 4\n5 6 7 8\n";
  EXPECT_TRUE(starts_as_ptx(ptx));
  EXPECT_FALSE(starts_as_ptx(pts));
  EXPECT_FALSE(starts_as_pts(ptx));
  EXPECT_TRUE(starts_as_pts(pts));
  EXPECT_TRUE(starts_as_pts("2\r\n\r\n1 2 3\r\n"));
  EXPECT_TRUE(starts_as_pts("2\r1 2 3\r"));
  EXPECT_FALSE(starts_as_pts("1 2 3\n4 5 6\n"));
  EXPECT_FALSE(starts_as_pts("2\n3\n"));
  EXPECT_FALSE(starts_as_ptx(ptx.substr(0, ptx.size() - 1))) << "the last line may go on";
  EXPECT_FALSE(starts_as_ptx("OFF\n" + ptx));
}

struct BadText {
  std::string text;
  std::vector<std::string> parts;
  std::int64_t line;
};

void expect_refused(ReadFile read, StreamFile open, const std::vector<BadText>& cases) {
  for (const BadText& bad : cases) {
    SCOPED_TRACE(bad.text.substr(0, 60));
    expect_named(decode(read, bad.text), bad.parts, bad.line);
    const Result<std::vector<Vec3>> streamed = stream(open, bad.text, 100);
    ASSERT_FALSE(streamed);
    EXPECT_EQ(streamed.error().file, kFileName);
  }
}

TEST(ScanTextHostile, EachWrongThingIsNamed) {
  std::string shear = kUnitPose, many_columns = "1\n" + std::string(80, '1') + std::string(40, ' ') + "2 3 4";
  shear.replace(shear.find("1 0 0 0"), 7, "1 0 0 7");
  for (int i = 0; i < 40; ++i) many_columns += " 1";
  expect_refused(read_ptx, ptx_stream,
                 {{"\n\n", {"no points"}, 2},
                  {"3\n-2\n" + kUnitPose, {"rows of scan 1", "'-2'"}, 2},
                  {"3 4\n2\n" + kUnitPose, {"columns of scan 1", "'3 4'"}, 1},
                  {"3\n2\n0 0\n", {"pose of scan 1", "'0 0'"}, 3},
                  {"3\n2\n0 0 nan\n", {"pose of scan 1"}, 3},
                  {"3\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0\n", {"matrix of scan 1"}, 7},
                  {"3\n2\n0 0 0\n", {"ten lines before scan 1", "cut off"}, 3},
                  {"1\n1\n" + shear + "1 2 3 4\n", {"no motion", "7"}, 7},
                  {"100000\n100000\n" + kUnitPose, {"100000 x 100000", "no room"}, 10},
                  {"9000000000000000000\n9000000000000000000\n" + kUnitPose, {"no room"}, 10},
                  {"1\n2\n" + kUnitPose + "1 2 3 4\n", {"after 1 of the 2 promised points"}, 11},
                  {"1\n1\n" + kUnitPose + "1 2 3 4\n1 2 3 4\n", {"columns of scan 2", "before"}, 12},
                  {"1\n2\n" + kUnitPose + "1 2 3 4\n1 2 3\n", {"has 3 columns, the first has 4"}, 12},
                  {"1\n1\n" + kUnitPose + "1 2 three 4\n", {"'three' is not a number"}, 11},
                  {"1\n1\n" + kUnitPose + "1 2 \n\n", {"at least 3 columns"}, 11}});
  expect_refused(read_pts, pts_stream,
                 {{"\n# nothing\n", {"no points"}, 2},
                  {"3\n1 2 3\n", {"promises 3 points", "holds 1"}, 2},
                  {"1\n1 2 3\n2\n1 2 3\n", {"block 2 promises 2 points"}, 4},
                  {"1\n1 2 3\n1,5 2 3\n", {"'1,5' is not a number"}, 3},
                  {"2\n1 2 3\n1 2 3 4\n", {"4 columns, the first has 3"}, 3},
                  {"-2\n1 2 3\n", {"at least 3 columns"}, 1},
                  {many_columns, {"more than 32 columns"}, 2}});
  EXPECT_TRUE(
      test::refused(decode(read_pts, "9000000000000000000\n1 2 3\n"), "9000000000000000000", "memory"));
}

TEST(ScanTextHostile, TruncationsAndFlipsGivePointsOrErrors) {
  const std::string ptx =
      "2\n2\n" + kTurned + "1 2 3 0.5\n0 0 0 0.5\n4 5 6 1\n7 8 9 1\n1\n1\n" + kUnitPose + "1 2 3 1 7 8 9\n";
  const std::string pts = "2\n1 2 3 9 1 2 3\n4 5 6 9 1 2 3\n1\n7 8 9\n";
  // With the hole, of which a flip makes a point, and a digit that another count takes for one.
  const std::tuple<ReadFile, StreamFile, std::string, std::size_t> formats[] = {
      {read_ptx, ptx_stream, ptx, 5}, {read_pts, pts_stream, pts, 4}};
  for (const auto& [read, open, text, most] : formats) {
    const auto expect_agreement = [&, read = read, open = open, most = most](const std::string& wrong) {
      const Result<DecodedFile> decoded = decode(read, wrong, std::uint64_t{1} << 20);
      const Result<std::vector<Vec3>> streamed = stream(open, wrong, 3);
      EXPECT_EQ(decoded.ok(), streamed.ok()) << wrong;
      if (!decoded || !streamed) return;
      EXPECT_EQ(decoded->points.size(), streamed->size());
      EXPECT_LE(decoded->points.size(), most);
    };
    test::each_cut(text, text.size(), expect_agreement);
    test::each_flip(text, {0x01, 0x10, 0x40, 0xFF}, expect_agreement);
  }
}

// Real files, where $PALPATE_DATA is set; the first point of each as its text and matrix have it.
TEST(ScanTextShared, FilesOfScannersAreRead) {
  if (shared_data("formats/ptx").empty()) GTEST_SKIP() << "no folder formats/ptx in PALPATE_DATA";
  const std::filesystem::path folder = shared_data("formats");
  struct Known {
    ReadFile read;
    StreamFile stream;
    const char* name;
    std::size_t points;
    Vec3 first;
    std::size_t properties;
  };
  const Known files[] = {
      {read_ptx, ptx_stream, "ptx/1.2-with-color.ptx", 1065, {637012.24, 849028.31, 431.66}, 4},
      {read_ptx, ptx_stream, "ptx/no-color.ptx", 15, {637012.24, 849028.31, 431.66}, 1},
      {read_ptx, ptx_stream, "ptx/multiple-and-transform.ptx", 8, {637012.24, 849028.31, 431.66}, 1},
      // By hand: -0.00563 times the first row of the matrix, 0.645218 the second, -0.440506 the third, plus
      // the last.
      {read_ptx,
       ptx_stream,
       "ptx/complex-transform.ptx",
       4,
       {-3.03440738079, -3.173781036324, -1.823750041614},
       4},
      {read_pts, pts_stream, "pts/autzen.pts", 10, {636110.300003, 849345.050003, 512.139999}, 4},
      {read_pts, pts_stream, "pts/bunny_8.pts", 9, {-0.037829, 0.12794, 0.004474}, 0},
      {read_pts, pts_stream, "pts/site_56_8.pts", 8, {6691.797611, 17.347517, 1203.033447}, 1},
  };
  for (const Known& known : files) {
    SCOPED_TRACE(known.name);
    const std::string text =
        test::value_of(read_file((folder / known.name).string(), std::uint64_t{1} << 20));
    const DecodedFile decoded = test::value_of(decode(known.read, text));
    ASSERT_EQ(decoded.points.size(), known.points);
    EXPECT_LE((decoded.points[0] - known.first).norm(), 1e-9);
    EXPECT_EQ(decoded.properties.size(), known.properties);
    EXPECT_EQ(test::value_of(stream(known.stream, text, 7)), decoded.points);
    const bool ptx = known.read == read_ptx;
    EXPECT_EQ(starts_as_ptx(text), ptx);
    EXPECT_EQ(starts_as_pts(text), !ptx);
  }
}

}  // namespace
}  // namespace palpate::io
