// E57 files: what they hold in every encoding, and that no damage of them does more than give an Error.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <random>

#include "compress.h"
#include "e57_writer.h"
#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/files.h"
#include "toolkit/io/point_stream.h"
#include "toolkit/io/read_e57.h"

namespace palpate::io {
namespace {

Result<DecodedFile> decode(const std::string& file, std::uint64_t max_bytes = kMemoryLimitBytes) {
  return decode(read_e57, file, max_bytes);
}
Result<std::vector<Vec3>> stream(const std::string& file, std::size_t piece) {
  return stream(e57_stream, file, piece);
}

void expect_points(const std::vector<Vec3>& got, const std::vector<Vec3>& want, double within) {
  ASSERT_EQ(got.size(), want.size());
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LE((got[i] - want[i]).norm(), within) << "point " << i;
}

const std::string kDoubles =
    "<cartesianX type=\"Float\"/><cartesianY type=\"Float\"/><cartesianZ type=\"Float\"/>";

E57TestScan scan_of_doubles(const std::vector<Vec3>& points) {
  std::array<BitStream, 3> axes;
  for (const Vec3& p : points)
    for (std::size_t a = 0; a < axes.size(); ++a) axes[a].put(p[static_cast<Eigen::Index>(a)]);
  return {kDoubles, {data_packet({axes[0].bytes(), axes[1].bytes(), axes[2].bytes()})}, points.size()};
}

std::string file_of(const E57TestScan& scan) {
  E57TestFile file;
  file.add(scan);
  return file.bytes();
}

const std::vector<Vec3> kSome{{1, 2, 3}, {-4.25, 5e6, 1e-9}, {0, 0, 0}, {1e300, -1, 7}};

TEST(E57, ChecksumIsCastagnoliS) {
  const std::string digits = "123456789";
  EXPECT_EQ(crc32c(std::as_bytes(std::span(digits))), 0xE3069283u);  // the published check value
  EXPECT_EQ(crc32c({}), 0u);
}

TEST(E57, DoublesComeBackExactly) {
  const std::string file = file_of(scan_of_doubles(kSome));
  const DecodedFile decoded = test::value_of(decode(file));
  EXPECT_EQ(decoded.points, kSome);
  EXPECT_EQ(decoded.unit, Unit::kMetre);
  EXPECT_TRUE(decoded.properties.empty());
  EXPECT_EQ(decoded.format, "E57 1.0, 1 scan");
}

// Records of every width across the borders of packets, streams of different lengths in one packet, packets
// of other kinds between.
TEST(E57, PackedIntegersCrossPackets) {
  std::mt19937_64 random(1);
  for (const unsigned bits : {1u, 3u, 7u, 8u, 13u, 31u, 33u, 57u, 63u, 64u}) {
    SCOPED_TRACE(bits);
    const std::int64_t low = bits >= 63 ? std::numeric_limits<std::int64_t>::min() : -5;
    const std::uint64_t most = bits == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << bits) - 1;
    const auto high = static_cast<std::int64_t>(static_cast<std::uint64_t>(low) + most);
    constexpr std::size_t kCount = 1000;
    BitStream x, y;
    std::vector<Vec3> want;
    for (std::size_t i = 0; i < kCount; ++i) {
      const std::uint64_t value = i == 0 ? 0 : i == 1 ? most : random() & most;
      const auto single = static_cast<float>(i) * 0.25F;
      x.put(value, bits);
      y.put(single);
      const auto whole =
          static_cast<double>(static_cast<std::int64_t>(static_cast<std::uint64_t>(low) + value));
      want.emplace_back(whole * 0.5 + 100.0, single, 42.0);
    }
    E57TestScan scan{fmt::format("<cartesianX type=\"ScaledInteger\" minimum=\"{}\" maximum=\"{}\" "
                                 "scale=\"5e-1\" offset=\"100\"/>"
                                 "<note type=\"String\"/>"
                                 "<cartesianY type=\"Float\" precision=\"single\"/>"
                                 "<cartesianZ type=\"Integer\" minimum=\"42\" maximum=\"42\"/>",
                                 low, high),
                     {index_packet()},
                     kCount};
    // Pieces of x and y that share no border; all of y may come before the last of x.
    std::size_t x_at = 0, y_at = 0;
    while (x_at < x.bytes().size() || y_at < y.bytes().size()) {
      const std::string x_piece = x.bytes().substr(std::min(x_at, x.bytes().size()), 11);
      const std::string y_piece = y.bytes().substr(std::min(y_at, y.bytes().size()), 803);
      x_at += x_piece.size();
      y_at += y_piece.size();
      scan.packets.push_back(data_packet({x_piece, "text", y_piece, ""}));
      if (scan.packets.size() % 3 == 0) scan.packets.push_back(empty_packet(8));
    }
    const std::string file = file_of(scan);
    const DecodedFile decoded = test::value_of(decode(file));
    EXPECT_EQ(decoded.points, want);
    for (const std::size_t piece : {std::size_t{1}, std::size_t{7}, std::size_t{5000}})
      EXPECT_EQ(test::value_of(stream(file, piece)), want);
  }
}

TEST(E57, PosesTurnAndMoveEachScan) {
  E57TestFile file;
  E57TestScan first = scan_of_doubles({{1, 2, 3}}), second = scan_of_doubles({{1, 2, 3}, {0, 0, 1}}),
              third = scan_of_doubles({{4, 5, 6}});
  // A quarter turn about z takes x to y: half angles of 45 degrees.
  first.more =
      "<name type=\"String\"><![CDATA[hall]]></name><pose type=\"Structure\"><rotation type=\"Structure\">"
      "<w type=\"Float\">0.70710678118654757</w><x type=\"Float\"/><y type=\"Float\"/>"
      "<z type=\"Float\">7.0710678118654757e-001</z></rotation><translation type=\"Structure\">"
      "<x type=\"Float\">100</x><y type=\"Float\">200</y><z type=\"Float\">-1.5</z></translation></pose>"
      "<cartesianBounds><xMinimum>0</xMinimum><xMaximum>1</xMaximum><yMinimum>0</yMinimum>"
      "<yMaximum>2</yMaximum><zMinimum>0</zMinimum><zMaximum>3</zMaximum></cartesianBounds>";
  // Half a turn about x.
  second.more = "<pose><rotation><w>0</w><x>1</x><y>0</y><z>0</z></rotation></pose>";
  file.add(first);
  file.add(second);
  file.add({kDoubles, {}, 0});
  file.add(third);
  const DecodedFile decoded = test::value_of(decode(file.bytes()));
  expect_points(decoded.points, {{98, 201, 1.5}, {1, -2, -3}, {0, 0, -1}, {4, 5, 6}}, 1e-12);
  EXPECT_EQ(decoded.format, "E57 1.0, 4 scans");
}

TEST(E57, StatedBoundsAreTurnedWithTheScan) {
  E57TestScan scan = scan_of_doubles({{1, 2, 3}});
  scan.more =
      "<pose><rotation><w>0</w><x>0</x><y>0</y><z>1</z></rotation><translation><x>10</x></translation></pose>"
      "<cartesianBounds><xMinimum>0</xMinimum><xMaximum>1</xMaximum><yMinimum>0</yMinimum>"
      "<yMaximum>2</yMaximum><zMinimum>0</zMinimum><zMaximum>3</zMaximum></cartesianBounds>";
  const std::string file = file_of(scan);
  const auto points =
      test::value_of(e57_stream(std::make_unique<MemoryAccess>(std::as_bytes(std::span(file))), "a.e57"));
  ASSERT_TRUE(points->header().bounds);
  EXPECT_LE((points->header().bounds->low_mm - Vec3(9, -2, 0)).norm(), 1e-12);
  EXPECT_LE((points->header().bounds->high_mm - Vec3(10, 0, 3)).norm(), 1e-12);
  EXPECT_EQ(points->header().points, 1u);
  EXPECT_EQ(points->header().unit, Unit::kMetre);
}

TEST(E57, SphericalCoordinatesAndInvalidStates) {
  BitStream range, azimuth, elevation, state;
  const double quarter = std::acos(0.0);
  const double rows[][4] = {{2, 0, 0, 0}, {2, quarter, 0, 0}, {2, 0, quarter, 0},
                            {5, 1, 1, 1}, {5, 1, 1, 2},       {2, quarter, -quarter / 2, 0}};
  for (const auto& row : rows) {
    range.put(row[0]);
    azimuth.put(row[1]);
    elevation.put(row[2]);
    state.put(static_cast<std::uint64_t>(row[3]), 2);
  }
  const std::string file =
      file_of({"<sphericalRange type=\"Float\"/><sphericalAzimuth type=\"Float\"/><sphericalElevation "
               "type=\"Float\"/>"
               "<sphericalInvalidState type=\"Integer\" minimum=\"0\" maximum=\"2\"/>",
               {data_packet({range.bytes(), azimuth.bytes(), elevation.bytes(), state.bytes()})},
               std::size(rows)});
  const DecodedFile decoded = test::value_of(decode(file));
  const double side = std::sqrt(2.0);
  expect_points(decoded.points, {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}, {0, side, -side}}, 1e-12);
  ASSERT_EQ(decoded.warnings.size(), 1u);
  EXPECT_TRUE(test::contains(decoded.warnings[0], "2 of the file's 6 records", "invalid"));
  EXPECT_EQ(test::value_of(stream(file, 1)).size(), 4u);
}

TEST(E57, IntensityAndColourArePropertiesAndMayBeMissing) {
  E57TestScan coloured = scan_of_doubles({{1, 2, 3}, {4, 5, 6}});
  BitStream x, intensity, red, none;
  for (const double value : {1.0, 4.0}) x.put(value);
  for (const unsigned value : {7u, 300u}) intensity.put(value, 9);
  for (const unsigned value : {255u, 1u}) red.put(value, 8);
  for (const unsigned value : {0u, 1u}) none.put(value, 1);
  coloured.prototype +=
      "<intensity type=\"ScaledInteger\" minimum=\"0\" maximum=\"511\" scale=\"0.5\"/>"
      "<colorRed type=\"Integer\" minimum=\"0\" maximum=\"255\"/>"
      "<isColorInvalid type=\"Integer\" minimum=\"0\" maximum=\"1\"/>";
  coloured.packets = {
      data_packet({x.bytes(), x.bytes(), x.bytes(), intensity.bytes(), red.bytes(), none.bytes()})};
  E57TestFile file;
  file.add(coloured);
  file.add(scan_of_doubles({{7, 8, 9}}));
  const DecodedFile decoded = test::value_of(decode(file.bytes()));
  ASSERT_EQ(decoded.properties.size(), 2u);
  EXPECT_EQ(decoded.properties[0].name, "intensity");
  EXPECT_EQ(decoded.properties[1].name, "red");
  const std::vector<float>& shade = decoded.properties[0].values;
  EXPECT_EQ((std::vector<float>(shade.begin(), shade.begin() + 2)), (std::vector<float>{3.5F, 150.0F}));
  EXPECT_TRUE(std::isnan(shade.at(2))) << "the second scan has none";
  EXPECT_EQ(decoded.properties[1].values[0], 255.0F);
  EXPECT_TRUE(std::isnan(decoded.properties[1].values[1])) << "marked as invalid";
}

TEST(E57, NoScansAndNoRecordsAreNoPoints) {
  E57TestFile none;
  EXPECT_TRUE(test::value_of(decode(none.bytes())).points.empty());
  EXPECT_TRUE(test::value_of(stream(none.bytes(), 10)).empty());
  EXPECT_TRUE(test::value_of(decode(file_of({kDoubles, {}, 0}))).points.empty());
}

// Each wrong thing gets its name and a remedy.
TEST(E57Hostile, EachWrongThingIsNamed) {
  const std::string good = file_of(scan_of_doubles(kSome));
  const auto with = [&](std::size_t at, const std::string& bytes) {
    std::string file = good;
    file.replace(at, bytes.size(), bytes);
    E57TestFile::seal(file);
    return file;
  };
  const auto scan_with = [](const auto& change) {
    E57TestScan scan = scan_of_doubles(kSome);
    change(scan);
    return file_of(scan);
  };
  const auto fields = [&](const std::string& prototype) {
    return scan_with([&](E57TestScan& scan) { scan.prototype = prototype; });
  };
  const auto records = [&](std::uint64_t count) {
    return scan_with([&](E57TestScan& scan) { scan.records = count; });
  };
  const auto beside = [&](const std::string& more) {
    return scan_with([&](E57TestScan& scan) { scan.more = more; });
  };
  const auto xml = [&](const std::string& text) {
    E57TestFile file;
    file.xml = text;
    return file.bytes();
  };
  E57TestScan codec = scan_of_doubles(kSome), short_scan = scan_of_doubles(kSome);
  codec.codecs = "<vectorChild><inputs/><zipCodec/></vectorChild>";
  short_scan.packets = {empty_packet(4000), data_packet({std::string(32, 'x'), std::string(32, 'y'), "z"})};
  constexpr std::size_t kSection = 48, kPacket = 80;  // both in the first page
  const std::string two = "<cartesianX type=\"Float\"/><cartesianY type=\"Float\"/>";
  const std::pair<std::string, std::vector<std::string>> cases[] = {
      {"LASF", {"no E57 file", "ASTM-E57"}},
      {"ASTM-E57", {"8 bytes"}},
      {with(8, little(2, 4)), {"version 2.0"}},
      {with(40, little(4096, 8)), {"pages of 4096"}},
      {with(16, little(1 << 20, 8)), {"states 1048576 bytes"}},
      {with(24, little(1022, 8)), {"XML", "byte 1022", "within a checksum"}},
      {with(24, little(1 << 20, 8)), {"XML", "behind the end"}},
      {with(32, little(1 << 20, 8)), {"1048576 bytes of XML"}},
      {with(kSection, "\7"), {"binary section of scan 1", "byte 48"}},
      {with(kSection + 8, little(1 << 20, 8)), {"length of 1048576"}},
      {with(kSection + 8, little(5, 8)), {"length of 5"}},
      {with(kSection + 16, little(48, 8)), {"data of scan 1", "byte 48", "outside"}},
      {with(kPacket, "\5"), {"byte 80", "unknown type 5"}},
      {with(kPacket + 2, little(1, 2)), {"byte 80", "has 2 bytes"}},
      {with(kPacket + 2, little(0xFFFB, 2)), {"byte 80", "65532 bytes"}},
      {with(kPacket + 4, little(2, 2)), {"2 streams", "3 fields"}},
      {with(kPacket + 6, little(9999, 2)), {"byte 80", "streams need"}},
      {records(5), {"promises 5 records", "scan 1"}},
      {records(1000000000000u), {"promises 1000000000000 records"}},
      {file_of(short_scan), {"field 'cartesianZ' is short"}},
      {file_of(codec), {"codec 'zipCodec'"}},
      {fields(two), {"neither cartesian nor spherical"}},
      {fields(two + "<cartesianZ type=\"String\"/>"), {"'cartesianZ'", "text"}},
      {fields(two + "<cartesianZ type=\"Blob\"/>"), {"'cartesianZ'", "'Blob'"}},
      {fields(two + "<cartesianX type=\"Float\"/>"), {"'cartesianX'", "twice"}},
      {fields(two + "<cartesianZ type=\"Float\" precision=\"half\"/>"), {"'half'"}},
      {fields(two + "<cartesianZ type=\"Integer\" minimum=\"2\" maximum=\"1\"/>"), {"minimum 2"}},
      {fields(two + "<cartesianZ type=\"Integer\" minimum=\"a\"/>"), {"'a'", "whole number"}},
      {fields(two + "<cartesianZ type=\"ScaledInteger\" scale=\"nan\"/>"), {"scale", "'nan'"}},
      {beside("<pose><rotation><w>0</w></rotation></pose>"), {"rotation of scan 1", "quaternion"}},
      {beside("<pose><translation><x>inf</x></translation></pose>"), {"translation of scan 1"}},
      {beside("<pose><translation><x>far</x></translation></pose>"), {"'far' in <x>"}},
      {xml("<e57Root>\n<data3D>"), {"line 2"}},
      {xml("<other/>"), {"no <e57Root>"}},
      {xml("<e57Root><data3D><vectorChild/></data3D></e57Root>"), {"scan 1 has no points"}},
      {xml("<e57Root><data3D><vectorChild><points/></vectorChild></data3D></e57Root>"), {"points of scan 1"}},
  };
  for (const auto& [file, parts] : cases) {
    SCOPED_TRACE(parts.front());
    const Result<DecodedFile> decoded = decode(file);
    expect_named(decoded, parts, decoded ? 0 : decoded.error().line);
    const Result<std::vector<Vec3>> streamed = stream(file, 100);
    ASSERT_FALSE(streamed);
    EXPECT_EQ(streamed.error().file, kFileName);
  }
  EXPECT_TRUE(test::refused(decode(good, 1000), "memory"));
}

// Records that take no bytes cannot be counted by the file's size.
TEST(E57Hostile, ConstantsAloneAreRefused) {
  const std::string one = " type=\"Integer\" minimum=\"1\" maximum=\"1\"/>";
  EXPECT_TRUE(test::refused(decode(file_of({"<cartesianX" + one + "<cartesianY" + one + "<cartesianZ" + one,
                                            {data_packet({"", "", ""})},
                                            1u << 30})),
                            "1073741824 records of 0 bits"));
}

TEST(E57Hostile, DeepXmlIsReadOrRefused) {
  std::string deep = "<e57Root>";
  for (int i = 0; i < 200000; ++i) deep += "<a>";
  E57TestFile file;
  file.xml = deep;
  EXPECT_FALSE(decode(file.bytes()));
  for (int i = 0; i < 200000; ++i) deep += "</a>";
  file.xml = deep + "</e57Root>";
  EXPECT_TRUE(decode(file.bytes()));
}

TEST(E57Hostile, EveryTruncationIsRefused) {
  E57TestFile two;
  two.add(scan_of_doubles(kSome));
  two.add(scan_of_doubles(std::vector<Vec3>(40, Vec3(1, 2, 3))));
  const std::string file = two.bytes();
  for (std::size_t length = 0; length < file.size(); length += 1 + length / 100) {
    SCOPED_TRACE(length);
    const std::string part = file.substr(0, length);
    EXPECT_FALSE(decode(part));
    EXPECT_FALSE(stream(part, 64));
  }
}

// A flipped bit is seen by the checksum; with the checksum made right it gives an Error or some points.
TEST(E57Hostile, EveryFlippedByteIsSeen) {
  const std::string file = file_of(scan_of_doubles(kSome));
  test::each_flip(file, {0x10}, [](const std::string& wrong) { EXPECT_FALSE(decode(wrong)); });
  test::each_flip(file, {0x01, 0x10, 0x80, 0xFF}, [](std::string& wrong) {
    E57TestFile::seal(wrong);
    const Result<DecodedFile> sealed = decode(wrong, std::uint64_t{1} << 20);
    EXPECT_TRUE(sealed ? sealed->points.size() <= 4 * 4 : !sealed.error().what.empty());
  });
}

// The reference files, where $PALPATE_DATA is set.
TEST(E57Shared, ReferenceFilesGiveTheirPointsOrTheirErrors) {
  const std::filesystem::path folder = shared_data("formats/e57");
  if (folder.empty()) GTEST_SKIP() << "no folder formats/e57 in PALPATE_DATA";
  const auto content = [&](const char* name) {
    return test::value_of(read_file((folder / name).string(), std::uint64_t{1} << 20));
  };
  const DecodedFile bunny = test::value_of(decode(content("bunnyInt32.e57")));
  ASSERT_EQ(bunny.points.size(), 30571u);
  geometry::Aabb box;
  for (const Vec3& p : bunny.points) box.add(p);
  // The bounds that its XML states, in steps of a micrometre.
  EXPECT_LE((box.low_mm - Vec3(-0.094689, 0.040011, -0.061873)).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_LE((box.high_mm - Vec3(0.061009, 0.187321, 0.058799)).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_EQ(test::value_of(stream(content("bunnyInt32.e57"), 1000)), bunny.points);

  const DecodedFile cube = test::value_of(decode(content("ColouredCubeFloat.e57")));
  ASSERT_EQ(cube.points.size(), 7680u);
  ASSERT_EQ(cube.properties.size(), 3u);
  for (std::size_t i = 0; i < cube.points.size(); ++i) {
    EXPECT_FLOAT_EQ(static_cast<float>(cube.points[i].cwiseAbs().maxCoeff()), 0.5F) << "on the cube";
    for (const cloud::Property& colour : cube.properties)
      EXPECT_TRUE(colour.values[i] >= 0.0F && colour.values[i] <= 255.0F);
  }

  EXPECT_TRUE(test::value_of(decode(content("empty.e57"))).points.empty());
  EXPECT_TRUE(test::value_of(decode(content("ZeroPoints.e57"))).points.empty());
  EXPECT_TRUE(test::refused(decode(content("bad-crc.e57")), "checksum of page 1"));
  EXPECT_TRUE(test::refused(decode(content("InvalidCVHeader.e57")), "binary section of scan 1", "byte 48"));
  EXPECT_TRUE(test::refused(decode(content("ZeroPointsInvalid.e57")), "binary section of scan 1", "byte 0"));
}

}  // namespace
}  // namespace palpate::io
