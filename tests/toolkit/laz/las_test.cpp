// LAS files made by the tests, LAZ files from disk: what is decoded must be what was written, byte by byte,
// and what is wrong must be refused with its place.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <string_view>

#include <palpate/progress.h>
#include "tests/toolkit/laz/las_files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/bytes.h"
#include "toolkit/io/las_header.h"
#include "toolkit/io/read_las.h"

namespace palpate::io {
namespace {

using Bytes = std::vector<std::byte>;

constexpr std::uint8_t kFormats = 11;

test::LasFile some_file(std::uint8_t format, std::size_t count) {
  test::LasFile file;
  file.format = format;
  file.points = test::scanned_points(format, 0, count, format + 1u);
  return file;
}

Result<DecodedFile> read(const Bytes& bytes, const ReadOptions& options = {}) {
  return read_las(MemoryAccess(bytes), "a.las", options, no_progress());
}

Result<std::unique_ptr<PointStream>> stream_of(const Bytes& bytes, int threads) {
  return las_stream(std::make_unique<MemoryAccess>(bytes), "a.laz", threads);
}

TEST(Laz, DecodesEveryFormatByteByByte) {
  for (std::uint8_t format = 0; format < kFormats; ++format)
    for (const char* kind : {"", "_extra", "_v4"}) {
      if (std::string_view(kind) == "_v4" && format != 8 && format != 10) continue;
      SCOPED_TRACE(fmt::format("format {}{}", format, kind));
      const Bytes bytes = test::laz_bytes(fmt::format("{}{}.laz", format, kind));
      for (const int threads : {1, 2})
        ASSERT_TRUE(test::value_of(test::raw_points(MemoryAccess(bytes), threads)) ==
                    test::laz_points(format, *kind != '\0' ? test::kLazExtraBytes : 0));
      const DecodedFile model = test::value_of(read(bytes));
      EXPECT_EQ(model.points.size(), test::kLazPoints);
      EXPECT_EQ(model.format, fmt::format("LAZ 1.4, point format {}", format));
    }
}

// Fields that stay the same take no room. A piece holds 16 MiB: 838,860 points of 20 bytes.
TEST(Laz, OneChunkOfEqualPointsComesInPieces) {
  for (const auto& [format, count, pieces] : {std::tuple(0, 1'000'000u, 2), std::tuple(8, 1000u, 1)}) {
    SCOPED_TRACE(format);
    const Bytes bytes = test::laz_bytes(fmt::format("same_{}.laz", format));
    const auto number = static_cast<std::uint8_t>(format);
    const Bytes one = test::scanned_points(number, 0, 1, number + 1u);
    const MemoryAccess access(bytes);
    const LasHeader header = test::value_of(read_las_header(access));
    LasPoints points = test::value_of(LasPoints::open(access, header, 2));
    std::size_t found = 0;
    int read = 0;
    for (;; ++read) {
      const auto piece = test::value_of(points.next());
      if (piece.empty()) break;
      for (std::size_t at = 0; at < piece.size(); at += one.size(), ++found)
        ASSERT_TRUE(std::equal(one.begin(), one.end(), piece.begin() + static_cast<std::ptrdiff_t>(at)));
    }
    EXPECT_EQ(found, count);
    EXPECT_EQ(read, pieces);
  }
}

TEST(Laz, TableAtTheEndOfTheFile) {
  Bytes bytes = test::laz_bytes("3.laz");
  const LasHeader header = test::value_of(read_las_header(MemoryAccess(bytes)));
  // A writer to a pipe leaves -1 in front of the chunks, and the table's place behind it.
  const auto place = bytes.begin() + static_cast<std::ptrdiff_t>(header.points_at);
  const Bytes table_at(place, place + 8);
  std::fill_n(place, 8, std::byte{0xFF});
  bytes.insert(bytes.end(), table_at.begin(), table_at.end());
  EXPECT_TRUE(test::value_of(test::raw_points(MemoryAccess(bytes), 2)) == test::laz_points(3, 0));
}

TEST(Las, PositionsAndPropertiesOfEveryFormat) {
  for (std::uint8_t format = 0; format < kFormats; ++format) {
    SCOPED_TRACE(fmt::format("format {}", format));
    test::LasFile file = some_file(format, 40);
    file.minor = format >= 6 ? 4 : format >= 4 ? 3 : format >= 2 ? 2 : format;
    const DecodedFile model = test::value_of(read(test::las_bytes(file)));
    EXPECT_EQ(model.format, fmt::format("LAS 1.{}, point format {}", file.minor, format));
    const bool coloured =
        format == 2 || format == 3 || format == 5 || format == 7 || format == 8 || format == 10;
    ASSERT_EQ(model.properties.size(), coloured ? 4u : 1u);
    ASSERT_EQ(model.points.size(), 40u);
    const std::size_t colour_at = format == 2 ? 20 : format < 6 ? 28 : 30;
    for (std::size_t i = 0; i < 40; ++i) {
      const auto point = std::span(file.points).subspan(i * test::las_point_bytes(format));
      ByteReader in(point);
      const double x = in.i32(), y = in.i32(), z = in.i32();
      EXPECT_EQ(model.points[i], Vec3(100.0 + x * 0.01, 200.0 + y * 0.01, 300.0 + z * 0.01));
      EXPECT_EQ(model.properties[0].values[i], static_cast<float>(in.u16()));
      if (!coloured) continue;
      ByteReader colours(point.subspan(colour_at));
      for (std::size_t c = 1; c < 4; ++c)
        EXPECT_EQ(model.properties[c].values[i], static_cast<float>(colours.u16()));
    }
  }
}

TEST(Las, AsAReaderOfBytes) {
  const Bytes bytes = test::laz_bytes("3.laz");
  Readers readers;
  readers.add({"laz"}, read_las_bytes);
  ReadOptions options;
  options.unit = Unit::kMillimetre;
  const ReadModel model =
      test::value_of(readers.read(std::make_unique<MemorySource>(bytes), "a.laz", options));
  EXPECT_EQ(model.cloud.size(), test::kLazPoints);
  EXPECT_EQ(model.cloud.properties.size(), 4u);
  EXPECT_EQ(model.format, "LAZ 1.4, point format 3");
  options.max_bytes = bytes.size() - 1;
  EXPECT_TRUE(test::refused(readers.read(std::make_unique<MemorySource>(bytes), "a.laz", options), "memory"));
}

TEST(Las, StreamsInOddPiecesAndAgain) {
  const Bytes bytes = test::laz_bytes("7.laz");
  const std::vector<Vec3> whole = test::value_of(read(bytes)).points;
  const auto stream = test::value_of(stream_of(bytes, 2));
  EXPECT_EQ(stream->header().points, test::kLazPoints);
  for (int turn = 0; turn < 2; ++turn) {
    std::vector<Vec3> all;
    std::array<Vec3, 37> piece;
    while (const std::size_t got = test::value_of(stream->read(piece)))
      all.insert(all.end(), piece.begin(), piece.begin() + static_cast<std::ptrdiff_t>(got));
    EXPECT_TRUE(all == whole);
    ASSERT_TRUE(stream->rewind());
  }
}

// The bytes of the last chunk are damaged, or cut off.
TEST(Las, ACutFileGivesItsPointsAndThenAnError) {
  Bytes compressed = test::laz_bytes("1.laz"), plain = test::las_bytes(some_file(1, 2000));
  std::fill_n(compressed.end() - 500, 400, std::byte{0xA5});
  plain.resize(plain.size() - 28 * 600 - 5);
  for (const auto& [bytes, whole] : {std::pair(compressed, test::kLazChunk), std::pair(plain, 1399ul)}) {
    SCOPED_TRACE(whole);
    const auto stream = test::value_of(stream_of(bytes, 2));
    std::vector<Vec3> out(5000);
    EXPECT_EQ(test::value_of(stream->read(out)), whole);
    const Result<std::size_t> next = stream->read(out);
    ASSERT_TRUE(test::refused(next, "a.laz", "byte"));
    EXPECT_FALSE(next.error().remedy.empty());
  }
}

Bytes keys_with_unit(std::uint16_t unit) {
  Bytes keys(2 * 4 * 3);
  ByteWriter out(keys);
  constexpr std::uint16_t kBeforeUnit[] = {1, 1, 0, 2, 1024, 0, 1, 1, 3076, 0, 1};
  for (const std::uint16_t value : kBeforeUnit) out.u16(value);
  out.u16(unit);
  return keys;
}

TEST(Las, UnitsOfKeysAndText) {
  struct Case {
    Bytes keys;
    std::string text;
    std::optional<Unit> unit;
    std::string warning;
  };
  const std::string geographic =
      "GEOGCS[\"WGS 84\",DATUM[\"W\",SPHEROID[\"W\",6378137,298.257]],UNIT[\"degree\",0.0174]]";
  const auto projected = [&](const std::string& unit) {
    return "PROJCS[\"A \"\"B\"\" ]\"," + geographic + ",PARAMETER[\"x\",5,UNIT[\"km\",1000]],UNIT[" + unit +
           "]]";
  };
  const std::string compound =
      "COMPD_CS[\"c\"," + projected("\"m\",1") + ",VERT_CS[\"v\",UNIT[\"foot\",0.3048]]]";
  const std::string crs = "PROJCRS[\"p\",CS[Cartesian,2],AXIS[\"E\",east,ORDER[1],LENGTHUNIT[\"metre\",1]]]";
  const Case cases[] = {
      {keys_with_unit(9001), "", Unit::kMetre, ""},
      {keys_with_unit(9002), "", std::nullopt, "0.3048 m"},
      {keys_with_unit(9003), "", std::nullopt, "0.304800609601"},
      {keys_with_unit(1), "", std::nullopt, ""},
      {{}, projected("\"metre\",1,AUTHORITY[\"EPSG\",\"9001\"]"), Unit::kMetre, ""},
      {{}, projected("\"US survey foot\",0.3048006096012192"), std::nullopt, "US survey feet"},
      {{}, projected("\"millimetre\",0.001"), Unit::kMillimetre, ""},
      {{}, geographic, std::nullopt, "degrees"},
      {{}, compound, Unit::kMetre, "heights"},
      {{}, crs, Unit::kMetre, ""},
      {{}, "PROJCS[\"unfinished", std::nullopt, ""},
      {{}, std::string(5000, '['), std::nullopt, ""},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.text);
    test::LasFile file = some_file(0, 3);
    if (!c.keys.empty()) test::add_record(file, "LASF_Projection", 34735, c.keys);
    if (!c.text.empty()) test::add_record(file, "LASF_Projection", 2112, std::as_bytes(std::span(c.text)));
    const auto model = test::value_of(read(test::las_bytes(file)));
    EXPECT_EQ(model.unit, c.unit);
    EXPECT_EQ(model.conventional_unit, Unit::kMetre);
    ASSERT_EQ(model.warnings.size(), c.warning.empty() ? 0u : 1u);
    for (const std::string& warning : model.warnings) EXPECT_TRUE(test::contains(warning, c.warning));
  }
}

struct WrongBytes {
  std::size_t at;
  std::vector<int> bytes;
  std::string part;  ///< of the message
};
/// A file with each of the wrong bytes has an Error with `part` and `also`, and a remedy.
void expect_refused(const Bytes& good, const std::vector<WrongBytes>& cases, const char* also) {
  for (const WrongBytes& c : cases) {
    Bytes bytes = good;
    for (std::size_t i = 0; i < c.bytes.size(); ++i) bytes[c.at + i] = static_cast<std::byte>(c.bytes[i]);
    const Result<DecodedFile> model = read(bytes);
    ASSERT_TRUE(test::refused(model, c.part, also)) << c.at;
    EXPECT_FALSE(model.error().remedy.empty());
  }
}

TEST(Las, WrongFieldsHaveErrorsThatNameTheByte) {
  const std::vector<WrongBytes> cases = {
      {0, {'X'}, "LASF"},
      {25, {9}, "version 1.9"},
      {94, {10, 0}, "byte 94"},
      {96, {255, 255, 255, 127}, "byte 96"},
      {96, {1, 0, 0, 0}, "byte 96"},
      {104, {11}, "byte 104"},
      {104, {0x81}, "byte 104"},
      {105, {12, 0}, "byte 105"},
      {131, {0, 0, 0, 0, 0, 0, 0, 0}, "byte 131"},
      {163, {0, 0, 0, 0, 0, 0, 0xF0, 0x7F}, "byte 163"},
      {247, {255, 255, 255, 255, 255}, "promises"},
  };
  const Bytes good = test::las_bytes(some_file(6, 30));
  expect_refused(good, cases, "a.las");
  ReadOptions small;
  small.max_bytes = 100;
  EXPECT_FALSE(read(good, small));
}

TEST(Laz, WrongRecordsAndTablesHaveErrors) {
  const Bytes good = test::laz_bytes("6.laz");
  const auto header = test::value_of(read_las_header(MemoryAccess(good)));
  const std::size_t record = 375 + 54, place = static_cast<std::size_t>(header.points_at);
  const auto table = static_cast<std::size_t>(ByteReader(std::span(good).subspan(place)).u64());
  const std::vector<WrongBytes> cases = {
      {record, {1}, "without chunks"},
      {record, {2}, "does not go with"},
      {record, {9}, "unknown"},
      {record + 12, {0, 0, 0, 0}, "chunks of 0"},
      {record + 32, {200}, "too few"},
      {record + 34, {77}, "unknown type 77"},
      {record + 36, {31}, "31 bytes"},
      {record + 38, {2}, "version 2"},
      {place, {0, 0, 0, 0, 0, 0, 0, 1}, "table of chunks"},
      {table, {1}, "version 1"},
      {table + 4, {255, 255, 255, 127}, "chunks"},
      {table + 4, {1, 0, 0, 0}, "of the 800"},
      {place + 8 + 30, {1, 0, 0, 0}, "says that it has 1 points"},
      {place + 8 + 34, {255, 255, 255, 255}, "layers"},
  };
  expect_refused(good, cases, "byte");
}

TEST(Laz, PointsThatNoChunkCanHoldAreRefused) {
  Bytes bytes = test::laz_bytes("6.laz");
  constexpr std::uint32_t kPromised = 100'000'000;
  constexpr std::size_t kCountAt = 247, kChunkPointsAt = 375 + 54 + 12;
  ByteWriter(std::span(bytes).subspan(kCountAt)).u64(kPromised);
  ByteWriter(std::span(bytes).subspan(kChunkPointsAt)).u32(kPromised);
  EXPECT_TRUE(test::refused(stream_of(bytes, 1), "cannot hold the 100000000 points", "byte"));
}

TEST(Laz, CutAndDamagedFilesDoNoHarm) {
  for (std::uint8_t format = 0; format < kFormats; ++format) {
    const Bytes good = test::laz_bytes(fmt::format("{}{}.laz", format, format % 2 == 0 ? "" : "_extra"));
    for (std::size_t length = 0; length < good.size(); length += 1 + length / 10) {
      SCOPED_TRACE(fmt::format("format {} cut at {}", format, length));
      const Bytes cut(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length));
      EXPECT_FALSE(read(cut));
    }
    std::uint32_t pattern = 1;
    for (std::size_t at = 0; at < good.size(); at += 1 + at / 20) {
      SCOPED_TRACE(fmt::format("format {} byte {} changed", format, at));
      pattern = pattern * 1664525u + 1013904223u;
      Bytes bad = good;
      bad[at] ^= static_cast<std::byte>(pattern >> 24 | 1u);
      test::expect_harmless(bad);
    }
  }
}

// What fuzzing begins with (tests/fuzz/fuzz_las.cpp), and what it found.
TEST(Laz, FilesOfTheCorpusDoNoHarm) {
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(std::string(PALPATE_CORPUS) + "/las")) {
    SCOPED_TRACE(entry.path().string());
    const std::string text = test::value_of(read_file(entry.path().string(), std::uint64_t{1} << 20));
    test::expect_harmless(std::as_bytes(std::span(text)));
    ++files;
  }
  EXPECT_GE(files, 6u);
}

}  // namespace
}  // namespace palpate::io
