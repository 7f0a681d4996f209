// Real LAS, LAZ and COPC files, where $PALPATE_DATA is set: what LASzip, laz-perf and PDAL wrote must come
// out as they meant it.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>

#include <palpate/progress.h>
#include "tests/files.h"
#include "tests/toolkit/laz/las_files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/bytes.h"
#include "toolkit/io/las_header.h"
#include "toolkit/io/read_las.h"

namespace palpate::io {
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
