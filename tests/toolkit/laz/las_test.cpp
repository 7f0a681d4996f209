// LAS and LAZ files made by the tests: what is decoded must be what was written, byte by byte, and what is
// wrong must be refused with its place.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>

#include <palpate/progress.h>
#include "tests/toolkit/laz/las_files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/bytes.h"
#include "toolkit/io/las_header.h"
#include "toolkit/io/las_points.h"
#include "toolkit/io/read_las.h"

namespace palpate::io {
namespace {

using Bytes = std::vector<std::byte>;

constexpr std::uint8_t kFormats = 11;

test::LasFile some_file(std::uint8_t format, std::size_t count, bool compressed) {
  test::LasFile file;
  file.format = format;
  file.compressed = compressed;
  file.points = test::scanned_points(format, 0, count, format + 1u);
  return file;
}

std::unique_ptr<RandomAccess> copy_of(const Bytes& bytes) {
  class Owner final : public RandomAccess {
   public:
    explicit Owner(Bytes bytes) : bytes_(std::move(bytes)), access_(bytes_) {}
    [[nodiscard]] std::uint64_t size() const noexcept override { return access_.size(); }
    [[nodiscard]] Status read_at(std::uint64_t offset, std::span<std::byte> out) const override {
      return access_.read_at(offset, out);
    }

   private:
    Bytes bytes_;
    MemoryAccess access_;
  };
  return std::make_unique<Owner>(bytes);
}

TEST(Laz, DecodesWhatWasEncoded) {
  for (std::uint8_t format = 0; format < kFormats; ++format) {
    for (const std::uint32_t version : {3u, 4u}) {
      for (const std::uint32_t chunk_points : {700u, 0u}) {
        for (const std::size_t extra : {std::size_t{0}, std::size_t{3}}) {
          SCOPED_TRACE(
              fmt::format("format {} version {} chunks {} extra {}", format, version, chunk_points, extra));
          test::LasFile file;
          file.format = format;
          file.extra_bytes = extra;
          file.compressed = true;
          file.chunk_points = chunk_points;
          file.layered_version = version;
          file.points = test::scanned_points(format, extra, 2500, 7u + format);
          const Bytes bytes = test::las_bytes(file);
          for (const int threads : {1, 2}) {
            const Result<Bytes> decoded = test::raw_points(MemoryAccess(bytes), threads);
            ASSERT_TRUE(decoded) << decoded.error().message();
            ASSERT_TRUE(*decoded == file.points);
          }
        }
      }
    }
  }
}

TEST(Laz, FieldsThatStayTheSameTakeNoRoom) {
  test::LasFile file = some_file(8, 1, true);
  const Bytes point = file.points;
  for (int i = 0; i < 999; ++i) file.points.insert(file.points.end(), point.begin(), point.end());
  file.chunk_points = 5000;
  const Bytes bytes = test::las_bytes(file);
  EXPECT_LT(bytes.size(), 1000u);  // of which 375 are the header
  const Result<Bytes> decoded = test::raw_points(MemoryAccess(bytes), 1);
  ASSERT_TRUE(decoded) << decoded.error().message();
  EXPECT_TRUE(*decoded == file.points);
}

TEST(Laz, ChunksLongerThanAPieceComeInPieces) {
  // 16 MiB of points of 20 bytes are 838,860: a file of a million in one chunk.
  test::LasFile file = some_file(0, 1000, true);
  const Bytes thousand = file.points;
  for (int i = 1; i < 1000; ++i) file.points.insert(file.points.end(), thousand.begin(), thousand.end());
  file.chunk_points = 2'000'000;
  const Bytes bytes = test::las_bytes(file);
  const MemoryAccess access(bytes);
  const Result<LasHeader> header = read_las_header(access);
  ASSERT_TRUE(header);
  Result<LasPoints> points = LasPoints::open(access, *header, 2);
  ASSERT_TRUE(points);
  std::size_t at = 0, pieces = 0;
  while (true) {
    const auto piece = points->next();
    ASSERT_TRUE(piece) << piece.error().message();
    if (piece->empty()) break;
    ASSERT_TRUE(
        std::equal(piece->begin(), piece->end(), file.points.begin() + static_cast<std::ptrdiff_t>(at)));
    at += piece->size();
    ++pieces;
  }
  EXPECT_EQ(at, file.points.size());
  EXPECT_EQ(pieces, 2u);
}

TEST(Laz, TableAtTheEndOfTheFile) {
  const test::LasFile file = some_file(3, 1500, true);
  Bytes bytes = test::las_bytes(file);
  const Result<LasHeader> header = read_las_header(MemoryAccess(bytes));
  ASSERT_TRUE(header);
  // A writer to a pipe leaves -1 in front of the chunks, and the table's place behind it.
  const auto place = static_cast<std::size_t>(header->points_at);
  const Bytes table_at(bytes.begin() + static_cast<std::ptrdiff_t>(place),
                       bytes.begin() + static_cast<std::ptrdiff_t>(place) + 8);
  std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(place), 8, std::byte{0xFF});
  bytes.insert(bytes.end(), table_at.begin(), table_at.end());
  const Result<Bytes> decoded = test::raw_points(MemoryAccess(bytes), 2);
  ASSERT_TRUE(decoded) << decoded.error().message();
  EXPECT_TRUE(*decoded == file.points);
}

TEST(Las, PositionsAndPropertiesOfEveryFormat) {
  for (std::uint8_t format = 0; format < kFormats; ++format) {
    for (const bool compressed : {false, true}) {
      SCOPED_TRACE(fmt::format("format {} compressed {}", format, compressed));
      test::LasFile file = some_file(format, 40, compressed);
      file.minor = format >= 6 ? 4 : format >= 4 ? 3 : format >= 2 ? 2 : format;
      const Bytes bytes = test::las_bytes(file);
      const Result<DecodedFile> model = read_las(MemoryAccess(bytes), "a.las", {}, no_progress());
      ASSERT_TRUE(model) << model.error().message();
      EXPECT_EQ(model->format, fmt::format("{} 1.{}, point format {}", compressed ? "LAZ" : "LAS",
                                           static_cast<int>(file.minor), static_cast<int>(format)));
      const bool coloured =
          format == 2 || format == 3 || format == 5 || format == 7 || format == 8 || format == 10;
      ASSERT_EQ(model->properties.size(), coloured ? 4u : 1u);
      ASSERT_EQ(model->points.size(), 40u);
      const std::size_t colour_at = format == 2 ? 20 : format < 6 ? 28 : 30;
      for (std::size_t i = 0; i < 40; ++i) {
        const auto point = std::span(file.points).subspan(i * test::las_point_bytes(format));
        ByteReader in(point);
        const double x = in.i32(), y = in.i32(), z = in.i32();
        EXPECT_EQ(model->points[i], Vec3(100.0 + x * 0.01, 200.0 + y * 0.01, 300.0 + z * 0.01));
        EXPECT_EQ(model->properties[0].values[i], static_cast<float>(in.u16()));
        if (!coloured) continue;
        ByteReader colours(point.subspan(colour_at));
        for (std::size_t c = 1; c < 4; ++c)
          EXPECT_EQ(model->properties[c].values[i], static_cast<float>(colours.u16()));
      }
    }
  }
}

TEST(Las, AsAReaderOfBytes) {
  const Bytes bytes = test::las_bytes(some_file(3, 100, true));
  Readers readers;
  readers.add({"laz"}, read_las_bytes);
  ReadOptions options;
  options.unit = Unit::kMillimetre;
  const Result<ReadModel> model = readers.read(std::make_unique<MemorySource>(bytes), "a.laz", options);
  ASSERT_TRUE(model) << model.error().message();
  EXPECT_EQ(model->cloud.size(), 100u);
  EXPECT_EQ(model->cloud.properties.size(), 4u);
  EXPECT_EQ(model->format, "LAZ 1.4, point format 3");
  options.max_bytes = bytes.size() - 1;
  EXPECT_TRUE(test::refused(readers.read(std::make_unique<MemorySource>(bytes), "a.laz", options), "memory"));
}

TEST(Las, StreamsInOddPiecesAndAgain) {
  const test::LasFile file = some_file(7, 3000, true);
  const Bytes bytes = test::las_bytes(file);
  const Result<DecodedFile> model = read_las(MemoryAccess(bytes), "a.laz", {}, no_progress());
  ASSERT_TRUE(model);
  auto stream = las_stream(copy_of(bytes), "a.laz", 2);
  ASSERT_TRUE(stream) << stream.error().message();
  EXPECT_EQ((*stream)->header().points, 3000u);
  for (int turn = 0; turn < 2; ++turn) {
    std::vector<Vec3> all;
    std::array<Vec3, 37> piece;
    while (true) {
      const Result<std::size_t> got = (*stream)->read(piece);
      ASSERT_TRUE(got) << got.error().message();
      if (*got == 0) break;
      all.insert(all.end(), piece.begin(), piece.begin() + static_cast<std::ptrdiff_t>(*got));
    }
    EXPECT_TRUE(all == model->points);
    ASSERT_TRUE((*stream)->rewind());
  }
}

TEST(Las, ACutFileGivesItsPointsAndThenAnError) {
  for (const bool compressed : {false, true}) {
    const test::LasFile file = some_file(1, 2000, compressed);
    Bytes bytes = test::las_bytes(file);
    if (compressed) {
      // A byte of the last of three chunks.
      const Result<LasHeader> header = read_las_header(MemoryAccess(bytes));
      ASSERT_TRUE(header);
      for (std::size_t i = 0; i < 400; ++i) bytes[bytes.size() - 500 + i] = std::byte{0xA5};
    } else {
      bytes.resize(bytes.size() - 28 * 600 - 5);
    }
    auto stream = las_stream(copy_of(bytes), "a.las", 2);
    ASSERT_TRUE(stream) << stream.error().message();
    std::vector<Vec3> out(5000);
    const Result<std::size_t> got = (*stream)->read(out);
    ASSERT_TRUE(got) << got.error().message();
    EXPECT_EQ(*got, compressed ? 1400u : 1399u);
    const Result<std::size_t> next = (*stream)->read(out);
    ASSERT_TRUE(test::refused(next, "a.las", "byte"));
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
  const Case cases[] = {
      {keys_with_unit(9001), "", Unit::kMetre, ""},
      {keys_with_unit(9002), "", std::nullopt, "0.3048 m"},
      {keys_with_unit(9003), "", std::nullopt, "0.304800609601"},
      {keys_with_unit(1), "", std::nullopt, ""},
      {{}, projected("\"metre\",1,AUTHORITY[\"EPSG\",\"9001\"]"), Unit::kMetre, ""},
      {{}, projected("\"US survey foot\",0.3048006096012192"), std::nullopt, "US survey feet"},
      {{}, projected("\"millimetre\",0.001"), Unit::kMillimetre, ""},
      {{}, geographic, std::nullopt, "degrees"},
      {{},
       "COMPD_CS[\"c\"," + projected("\"m\",1") + ",VERT_CS[\"v\",UNIT[\"foot\",0.3048]]]",
       Unit::kMetre,
       "heights"},
      {{},
       "PROJCRS[\"p\",CS[Cartesian,2],AXIS[\"E\",east,ORDER[1],LENGTHUNIT[\"metre\",1]]]",
       Unit::kMetre,
       ""},
      {{}, "PROJCS[\"unfinished", std::nullopt, ""},
      {{}, std::string(5000, '['), std::nullopt, ""},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.text);
    test::LasFile file = some_file(0, 3, false);
    if (!c.keys.empty()) test::add_record(file, "LASF_Projection", 34735, c.keys);
    if (!c.text.empty()) test::add_record(file, "LASF_Projection", 2112, std::as_bytes(std::span(c.text)));
    const Bytes bytes = test::las_bytes(file);
    const Result<DecodedFile> model = read_las(MemoryAccess(bytes), "a.las", {}, no_progress());
    ASSERT_TRUE(model) << model.error().message();
    EXPECT_EQ(model->unit, c.unit);
    EXPECT_EQ(model->conventional_unit, Unit::kMetre);
    ASSERT_EQ(model->warnings.size(), c.warning.empty() ? 0u : 1u);
    for (const std::string& warning : model->warnings) EXPECT_TRUE(test::contains(warning, c.warning));
  }
}

TEST(Las, WrongFieldsHaveErrorsThatNameTheByte) {
  struct Case {
    std::size_t at;
    std::vector<int> bytes;
    std::string part;
  };
  const Case cases[] = {
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
  const Bytes good = test::las_bytes(some_file(6, 30, false));
  for (const Case& c : cases) {
    Bytes bytes = good;
    for (std::size_t i = 0; i < c.bytes.size(); ++i) bytes[c.at + i] = static_cast<std::byte>(c.bytes[i]);
    const Result<DecodedFile> model = read_las(MemoryAccess(bytes), "a.las", {}, no_progress());
    ASSERT_TRUE(test::refused(model, c.part, "a.las")) << c.at;
    EXPECT_FALSE(model.error().remedy.empty());
  }
  ReadOptions small;
  small.max_bytes = 100;
  EXPECT_FALSE(read_las(MemoryAccess(good), "a.las", small, no_progress()));
}

TEST(Laz, WrongRecordsAndTablesHaveErrors) {
  const Bytes good = test::las_bytes(some_file(6, 3000, true));
  const Result<LasHeader> header = read_las_header(MemoryAccess(good));
  ASSERT_TRUE(header);
  const std::size_t record = 375 + 54, place = static_cast<std::size_t>(header->points_at);
  const auto table = static_cast<std::size_t>(ByteReader(std::span(good).subspan(place)).u64());
  struct Case {
    std::size_t at;
    std::vector<int> bytes;
    std::string part;
  };
  const Case cases[] = {
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
      {table + 4, {1, 0, 0, 0}, "of the 3000"},
      {place + 8 + 30, {1, 0, 0, 0}, "says that it has 1 points"},
      {place + 8 + 34, {255, 255, 255, 255}, "layers"},
  };
  for (const Case& c : cases) {
    Bytes bytes = good;
    for (std::size_t i = 0; i < c.bytes.size(); ++i) bytes[c.at + i] = static_cast<std::byte>(c.bytes[i]);
    const Result<DecodedFile> model = read_las(MemoryAccess(bytes), "a.laz", {}, no_progress());
    ASSERT_TRUE(test::refused(model, c.part, "byte")) << c.at;
    EXPECT_FALSE(model.error().remedy.empty());
  }
}

TEST(Laz, PointsThatNoChunkCanHoldAreRefused) {
  Bytes bytes = test::las_bytes(some_file(6, 100, true));
  constexpr std::uint32_t kPromised = 100'000'000;
  constexpr std::size_t kCountAt = 247, kChunkPointsAt = 375 + 54 + 12;
  ByteWriter(std::span(bytes).subspan(kCountAt)).u64(kPromised);
  ByteWriter(std::span(bytes).subspan(kChunkPointsAt)).u32(kPromised);
  EXPECT_TRUE(
      test::refused(las_stream(copy_of(bytes), "a.laz", 1), "cannot hold the 100000000 points", "byte"));
}

TEST(Laz, CutAndDamagedFilesDoNoHarm) {
  for (std::uint8_t format = 0; format < kFormats; ++format) {
    test::LasFile file = some_file(format, 300, true);
    file.chunk_points = format % 2 == 0 ? 120 : 0;
    test::add_record(file, "LASF_Projection", 34735, keys_with_unit(9003));
    const Bytes good = test::las_bytes(file);
    for (std::size_t length = 0; length < good.size(); length += 1 + length / 20) {
      SCOPED_TRACE(fmt::format("format {} cut at {}", format, length));
      const Bytes cut(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length));
      EXPECT_FALSE(read_las(MemoryAccess(cut), "a.laz", {}, no_progress()));
    }
    std::uint32_t pattern = 1;
    for (std::size_t at = 0; at < good.size(); at += 1 + at / 50) {
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
