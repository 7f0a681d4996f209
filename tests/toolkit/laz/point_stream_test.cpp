// Points in pieces, opened by content whatever the name: LAS, binary PLY, binary PCD; and what is refused.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <palpate/progress.h>
#include "tests/files.h"
#include "tests/toolkit/laz/las_files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/bytes.h"
#include "toolkit/io/las_header.h"
#include "toolkit/io/point_stream.h"
#include "toolkit/io/read_las.h"

namespace palpate::io {
namespace {

constexpr std::size_t kPoints = 1000;

Vec3 point_of(std::size_t i) {
  const auto at = static_cast<double>(i);
  return {at, 0.5 * at, -2.0 * at};
}

// The bytes of a number, the first one first, or last where `swap`.
template <class T>
std::string bytes_of(T number, bool swap = false) {
  auto bytes = std::bit_cast<std::array<char, sizeof(T)>>(number);
  if (swap) std::reverse(bytes.begin(), bytes.end());
  return {bytes.data(), bytes.size()};
}

// Rows of a byte, y and z as float, a short, and x as double.
std::string rows(bool swap) {
  std::string text;
  for (std::size_t i = 0; i < kPoints; ++i) {
    const Vec3 p = point_of(i);
    text += std::string("!") + bytes_of(static_cast<float>(p.y()), swap) +
            bytes_of(static_cast<float>(p.z()), swap) + bytes_of(std::uint16_t{7}, swap) +
            bytes_of(p.x(), swap);
  }
  return text;
}

std::string ply(const std::string& format, bool swap) {
  return fmt::format(
             "ply\nformat {} 1.0\ncomment unit mm\nelement camera 2\nproperty float f\nelement vertex {}\n"
             "property uchar kind\nproperty float y\nproperty float z\nproperty short s\nproperty double x\n"
             "element face 1\nproperty list uchar int vertex_indices\nend_header\n",
             format, kPoints) +
         "camera88" + rows(swap) + std::string("\3") + std::string(12, '\0');
}

std::string pcd(const std::string& data) {
  return fmt::format(
      "# .PCD v0.7\nVERSION 0.7\nFIELDS kind y z s x\nSIZE 1 4 4 2 8\nTYPE U F F U F\nCOUNT 1 1 1 1 1\n"
      "WIDTH {}\nHEIGHT 1\nPOINTS {}\nDATA {}\n",
      kPoints, kPoints, data);
}

class Streams : public InFolder {
 protected:
  [[nodiscard]] std::string write(const std::string& name, const std::string& content) const {
    std::ofstream(in(name), std::ios::binary) << content;
    return in(name);
  }
};

void expect_points(const std::string& path) {
  SCOPED_TRACE(path);
  const std::unique_ptr<PointStream> stream = test::value_of(open_point_stream(path, 1));
  EXPECT_EQ(stream->header().points, kPoints);
  for (int turn = 0; turn < 2; ++turn) {
    std::array<Vec3, 300> piece;
    std::size_t at = 0;
    while (const std::size_t got = test::value_of(stream->read(piece)))
      for (std::size_t i = 0; i < got; ++i) ASSERT_EQ(piece[i], point_of(at++));
    EXPECT_EQ(at, kPoints);
    ASSERT_TRUE(stream->rewind());
  }
}

TEST_F(Streams, BinaryPlyInBothOrdersOfBytes) {
  expect_points(write("a.ply", ply("binary_little_endian", false)));
  const std::string big = write("b.dat", ply("binary_big_endian", true));
  expect_points(big);
  EXPECT_EQ(test::value_of(open_point_stream(big, 1))->header().unit, Unit::kMillimetre);
}

TEST_F(Streams, BinaryPcd) {
  const std::string path = write("a.pcd", pcd("binary") + rows(false));
  expect_points(path);
  EXPECT_EQ(test::value_of(open_point_stream(path, 1))->header().conventional_unit, Unit::kMetre);
}

TEST_F(Streams, LasAndLaz) {
  test::LasFile plain;
  plain.points = test::laz_points(0, 0);
  for (const auto& [bytes, kind] :
       {std::pair(test::las_bytes(plain), "LAS"), std::pair(test::laz_bytes("0.laz"), "LAZ")}) {
    const std::string path =
        write("scan", std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
    const std::unique_ptr<PointStream> stream = test::value_of(open_point_stream(path, 2));
    EXPECT_TRUE(test::contains(stream->header().format, kind, "point format 0"));
    std::vector<Vec3> points(2 * kPoints);
    EXPECT_EQ(test::value_of(stream->read(points)), test::kLazPoints);
    EXPECT_EQ(test::value_of(stream->read(points)), 0u);
  }
}

TEST_F(Streams, WhatCannotBeReadInPiecesIsRefusedWithARemedy) {
  struct Case {
    std::string content, part;
  };
  const std::string cut = pcd("binary") + rows(false).substr(1);
  const Case cases[] = {
      {"", "empty"},
      {"hello\nworld\n", "first bytes"},
      {"\x1F\x8B\x08 gzip", "gunzip"},
      {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float "
       "z\nend_header\n"
       "1 2 3\n",
       "binary PLY"},
      {"ply\nformat binary_little_endian 1.0\nelement face 0\nproperty list uchar int i\nelement vertex 0\n"
       "property float x\nproperty float y\nproperty float z\nend_header\n",
       "lists"},
      {"ply\nformat binary_little_endian 1.0\nelement other 0\nproperty int i\nend_header\n", "vertex"},
      {pcd("ascii") + "1 2 3 4 5\n", "binary PCD"},
      {pcd("binary_compressed") + rows(false), "compressed"},
      {cut, "promises 1000"},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.part);
    const auto stream = open_point_stream(write("bad", c.content), 1);
    ASSERT_TRUE(test::refused(stream, c.part, in("bad")));
    EXPECT_FALSE(stream.error().remedy.empty());
  }
  EXPECT_TRUE(test::refused(open_point_stream(in("missing"), 1), "missing"));
}

}  // namespace

// Real LAS, LAZ and COPC files, where $PALPATE_DATA is set: what LASzip, laz-perf and PDAL wrote must come
// out as they meant it.

namespace {

using Bytes = std::vector<std::byte>;

Result<Bytes> contents(const std::filesystem::path& path) {
  DecompressionLimits limits;
  PALPATE_ASSIGN(std::unique_ptr<ByteSource> file, open_file(path.string()));
  PALPATE_ASSIGN(std::unique_ptr<ByteSource> bytes, open_maybe_compressed(std::move(file), limits));
  return read_all(*bytes, limits.max_bytes);
}

class RealLas : public testing::Test {
 protected:
  void SetUp() override {
    if (shared_data("formats/laz").empty()) GTEST_SKIP() << "no folder formats/laz in PALPATE_DATA";
    folder_ = shared_data("formats");
  }
  [[nodiscard]] Bytes raw(const std::string& name, int threads = 1) const {
    const Bytes bytes = test::value_of(contents(folder_ / name));
    return test::value_of(test::raw_points(MemoryAccess(bytes), threads));
  }
  std::filesystem::path folder_;
};

TEST_F(RealLas, LazIsLasByteByByte) {
  for (const std::string name :
       {"1815", "extrabytes", "point-color-time", "point-color", "point-time", "point10"}) {
    SCOPED_TRACE(name);
    const Bytes las = raw("las/" + name + ".las");
    EXPECT_FALSE(las.empty());
    EXPECT_TRUE(las == raw("laz/" + name + ".laz"));
  }
  const Bytes autzen = raw("las/autzen_trim.las.xz");
  EXPECT_EQ(autzen.size(), 110000u * 34u);
  for (const int threads : {1, 2}) EXPECT_TRUE(autzen == raw("laz/autzen_trim.laz", threads));
  EXPECT_TRUE(raw("las/point-time.las") == raw("laz/point-time-1.4.laz"));
}

// Position in hundredths, intensity, number and count of returns, class, user data, source, time and colour.
using Row = std::array<std::int64_t, 13>;

// The points of a file in the order of their values.
std::vector<Row> sorted_rows(const Bytes& bytes) {
  const MemoryAccess file(bytes);
  const LasHeader header = test::value_of(read_las_header(file));
  const Bytes points = test::value_of(test::raw_points(file, 2));
  const bool layered = header.point_format >= 6;
  std::vector<Row> rows;
  for (std::size_t at = 0; at < points.size(); at += header.point_bytes) {
    ByteReader in(std::span<const std::byte>(points).subspan(at));
    Row row{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<Eigen::Index>(axis);
      row[axis] = std::llround((in.i32() * header.scale[i] + header.offset[i]) * 100.0);
    }
    row[3] = in.u16();
    const int returns = in.u8();
    row[4] = returns & (layered ? 15 : 7);
    row[5] = layered ? returns >> 4 : returns >> 3 & 7;
    if (layered) (void)in.u8();
    row[6] = in.u8();
    if (!layered) (void)in.u8();
    row[7] = in.u8();
    if (layered) (void)in.u16();
    row[8] = in.u16();
    row[9] = in.i64();
    for (std::size_t k = 10; k < 13; ++k) row[k] = in.u16();
    rows.push_back(row);
  }
  std::sort(rows.begin(), rows.end());
  return rows;
}

// Angles alone differ: formats 6 and later have finer ones.
TEST_F(RealLas, CopcHoldsTheSamePointsAsAFileOfFormat3) {
  const std::vector<Row> copc =
      sorted_rows(test::value_of(contents(folder_ / "copc/1.2-with-color.copc.laz")));
  EXPECT_EQ(copc.size(), 1065u);
  EXPECT_TRUE(copc == sorted_rows(test::value_of(contents(folder_ / "las/extrabytes.las"))));
}

TEST_F(RealLas, CutAndDamagedFilesDoNoHarm) {
  for (const std::string name :
       {"laz/extrabytes.laz", "laz/point-time-1.4.laz", "copc/1.2-with-color.copc.laz", "las/test1_4.las",
        "las/bad_vlr_count.las"}) {
    const auto good = test::value_of(contents(folder_ / name));
    for (std::size_t length = 0; length < good.size(); length += 1 + length / 12)
      test::expect_harmless(Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length)));
    for (std::size_t at = 0; at < good.size(); at += 1 + at / 20) {
      Bytes bad = good;
      bad[at] ^= std::byte{0x55};
      test::expect_harmless(bad);
    }
  }
}

TEST_F(RealLas, RecordsBeyondTheirPlaceAreLeftOut) {
  const auto bytes = test::value_of(contents(folder_ / "las/bad_vlr_count.las"));
  const auto model = test::value_of(read_las(MemoryAccess(bytes), "a.las", {}, no_progress()));
  EXPECT_EQ(model.points.size(), 10u);
  ASSERT_EQ(model.warnings.size(), 1u);
  EXPECT_TRUE(test::contains(model.warnings[0], "byte 429"));
}

}  // namespace

}  // namespace palpate::io
