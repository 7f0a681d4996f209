// Tables of text as surveyors and spreadsheets write them: names, units, decimal commas, line ends, surplus
// rows.
#include <gtest/gtest.h>

#include <bit>
#include <cstring>

#include "compress.h"

namespace palpate::io {
namespace {

bool warns(const ReadModel& model, const std::string& part) {
  return std::any_of(model.warnings.begin(), model.warnings.end(),
                     [&](const std::string& warning) { return warning.find(part) != std::string::npos; });
}

void expect_point(const std::string& content, const Vec3& point, const std::string& name = "a.txt") {
  SCOPED_TRACE(content);
  ReadOptions options;
  options.unit = Unit::kMillimetre;
  const Result<ReadModel> model = read_text(content, name, options);
  ASSERT_TRUE(model) << model.error().message();
  EXPECT_EQ(model->cloud.point_mm(0), point);
}

TEST(Tables, NamesInCommentsAndOfSurveyorsCount) {
  const Vec3 point(1, 2, 3);
  expect_point("//Intensity X Y Z\n9 1 2 3\n", point);
  expect_point("# id x y z intensity\n\n7 1 2 3 9\n8 1 2 4 9\n", point);
  expect_point("% Z,Y,X\n3,2,1\n", point, "a.csv");
  expect_point("# I x(m) y(m) z(m)\n2\n9 1 2 3\n9 4 5 6\n", point, "a.pts");
  expect_point("id;\"X [mm]\";\"Y [mm]\";\"Z [mm]\"\n7;1;2;3\n", point, "a.csv");
  expect_point("id X [m] Y [m] Z [m]\n7 1 2 3\n", point);
  expect_point("Northing Easting Height\n2 1 3\n", point);
  expect_point("height;northing;easting\n3;2;1\n", point, "a.csv");
  expect_point("id,Point_X,Point_Y,Point_Z\n7,1,2,3\n", point, "a.csv");
  expect_point("# made of x y z by hand\n1 2 3\n", point);  // prose
}

TEST(Tables, UnitsInBracketsAreStatements) {
  const Result<ReadModel> model = read_text("# x(cm) y(cm) z(cm)\n1 2 3\n", "a.txt");
  ASSERT_TRUE(model) << model.error().message();
  EXPECT_EQ(model->unit, Unit::kCentimetre);
  EXPECT_FALSE(model->unit_guessed);
}

TEST(Tables, ColumnsTakenWithoutNamesAreSaid) {
  const Result<ReadModel> model = read_text("7 1 2 3\n8 4 5 6\n", "a.txt");
  ASSERT_TRUE(model);
  EXPECT_NE(model->format.find("columns 1, 2, 3 of 4; the first row is '7 1 2 3'"), std::string::npos)
      << model->format;
  const Result<ReadModel> named = read_text("a b c d\n7 1 2 3\n", "a.txt");
  ASSERT_TRUE(named);
  EXPECT_TRUE(warns(*named, "(a, b, c)"));
}

TEST(Tables, DecimalCommasAreToldFromSeparators) {
  const Vec3 point(1.5, -2.5, 3);
  expect_point("1,5;-2,5;3\n", point, "a.csv");
  expect_point("x;y;z\n1,5;-2,5;3\n", point, "a.csv");
  expect_point("1,5 -2,5 3\n", point);
  expect_point("1,5\t-2,5\t3,0\n", point);
  expect_point("1.5, -2.5, 3\n", point, "a.csv");
  expect_point("1.5,-2.5,3\n", point, "a.csv");
  const Result<ReadModel> late = read_text("1;2;3\n1,5;2,5;3\n", "a.csv");
  ASSERT_TRUE(late) << late.error().message();
  EXPECT_FALSE(read_text("1.5;2;3\n1,5;2,5;3\n", "a.csv")) << "both marks in one file";
}

TEST(Tables, CarriageReturnsAloneEndLines) {
  expect_point("# by hand\r1 2 3\r4 5 6\r", {1, 2, 3});
  expect_point("v 1 2 3\rv 4 5 6\r", {1, 2, 3}, "a.obj");
  expect_point("OFF\r1 0 0\r1 2 3\r", {1, 2, 3}, "a.off");
  expect_point(
      "ply\rformat ascii 1.0\relement vertex 1\rproperty float x\rproperty float y\rproperty float z\r"
      "end_header\r1 2 3\r",
      {1, 2, 3}, "a.ply");
}

TEST(Tables, SurplusRowsAreCountedAndSaid) {
  const Result<ReadModel> pts = read_text("1\n1 2 3\n4 5 6\n7 8 9\n", "a.pts");
  ASSERT_TRUE(pts);
  EXPECT_TRUE(warns(*pts, "promises 1 points, the file holds 2 more"));
  const std::string fields = "property float x\nproperty float y\nproperty float z\nend_header\n";
  const Result<ReadModel> ascii =
      read_text("ply\nformat ascii 1.0\nelement vertex 1\n" + fields + "1 2 3\n4 5 6\n\n7 8 9\n", "a.ply");
  ASSERT_TRUE(ascii);
  EXPECT_TRUE(warns(*ascii, "2 rows follow the last element"));
  const std::string binary =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\n" + fields + std::string(12, '\0');
  const Result<ReadModel> longer = read_text(binary + "abcde", "a.ply"),
                          exact = read_text(binary + "\n", "a.ply");
  ASSERT_TRUE(longer && exact);
  EXPECT_TRUE(warns(*longer, "5 bytes follow the last element"));
  EXPECT_FALSE(warns(*exact, "follow the last element"));
}

TEST(Tables, FloatsFarFromTheOriginSayTheirPrecision) {
  const auto grid_at = [](float place) {
    std::string file =
        "ply\nformat binary_little_endian 1.0\nelement vertex 100\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n";
    for (int i = 0; i < 100; ++i)
      for (const float v : {place + static_cast<float>(i % 10), static_cast<float>(i / 10), 0.0F}) {
        char bytes[sizeof v];
        std::memcpy(bytes, &v, sizeof v);
        file.append(bytes, sizeof v);
      }
    return file;
  };
  ReadOptions options;
  options.unit = Unit::kMillimetre;
  const Result<ReadModel> far = read_text(grid_at(4e6F), "a.ply", options);
  const Result<ReadModel> near = read_text(grid_at(4e3F), "a.ply", options);
  ASSERT_TRUE(far && near);
  EXPECT_TRUE(warns(*far, "precision of 0.25 mm"));
  EXPECT_FALSE(warns(*near, "precision"));
}

}  // namespace
}  // namespace palpate::io
