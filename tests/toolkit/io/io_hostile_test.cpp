// Bad files: each gets an Error that names file, line where one means something, what is wrong, what to do.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <limits>

#include <palpate/read_model.h>
#include "compress.h"
#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/io/byte_source.h"
#include "toolkit/io/pcd_header.h"

namespace palpate::io {
namespace {

const std::string kXyz = "property float x\nproperty float y\nproperty float z\n";

std::string ply(const std::string& vertices, const std::string& rest, const std::string& format = "ascii") {
  return "ply\nformat " + format + " 1.0\nelement vertex " + vertices + "\n" + kXyz + rest;
}

struct Case {
  std::string name, content;
  std::vector<std::string> parts;  // of the message
  std::int64_t line;
};

std::vector<Case> text_cases() {
  const std::string end = "end_header\n", list = "property list uchar int vertex_indices\n";
  const std::string ascii = "ply\nformat ascii 1.0\nelement ", little = "binary_little_endian";
  const std::string many = "1000000000000", row = "12345678901234567890123";
  return {
      {"a.ply", "", {"empty"}, 0},
      {"a.ply", "hello\n", {"no PLY file"}, 1},
      {"a.ply", "ply\nelement vertex 1\n" + kXyz + end, {"no format line"}, 6},
      {"a.ply", "ply\nformat ascii 2.0\n", {"version '2.0'"}, 2},
      {"a.ply", ply("many", end), {"'many'", "vertex", "whole number"}, 3},
      {"a.ply", ply("-3", end), {"'-3'", "whole number"}, 3},
      {"a.ply", ply("1", "property half w\n" + end), {"unknown type 'half'"}, 7},
      {"a.ply", ply("1", "property float x\n" + end), {"'x' stands twice"}, 7},
      {"a.ply", ply("1", "property list float int l\n" + end), {"'float' is no type for a list's count"}, 7},
      {"a.ply", ply("1", ""), {"ends before end_header"}, 6},
      {"a.ply", ascii + "vertex 1\nproperty float x\n" + end + "1\n", {"x, y and z"}, 0},
      {"a.ply", ascii + "face 1\n" + list + end + "3 0 1 2\n", {"no element 'vertex'"}, 5},
      {"a.ply", ply("0", end), {"no points"}, 0},
      {"a.ply", ply("3", end + "1 2 3\n4 5 6\n"), {"promises 3", "'vertex'", "cut off"}, 0},
      {"a.ply.gz", gzipped(ply("3", end + "1 2 3\n4 5 6\n")), {"after 2 of the 3 promised", "cut off"}, 9},
      {"a.ply", ply("2", end + "1 2 3\n4 five 6\n"), {"'five' is not a number"}, 9},
      {"a.ply", ply("2", end + "1 2 3\n4 5\n6 7 8\n"), {"too few values"}, 9},
      {"a.ply", ply("2", end + "1 2 3\n4 5 6 7\n"), {"more values"}, 9},
      {"a.ply", ply(many, end + "1 2 3\n"), {many, "only 6 bytes"}, 0},
      {"a.ply.xz", xz_packed(ply(many, end + "1 2 3\n")), {many + " points", "memory allowed"}, 0},
      {"a.ply", ply("2", end + row, little), {"promises 2", "cut off"}, 0},
      {"a.ply.gz", gzipped(ply("2", end + row, little)), {"after 1 of the 2 promised"}, 0},
      {"a.ply", ply("1", "element face 1\n" + list + end + "1 2 3\n-1 0\n"), {"count is -1"}, 11},
      {"a.ply",
       ply("1", "element face 2\n" + list + end + "1 2 3\n3 0 0 0\n3 0 0\n"),
       {"too few values"},
       12},
      {"a.xyz", "# nothing\n\n", {"no points"}, 2},
      {"a.xyz", "1 2\n", {"at least 3 columns", "has 2"}, 1},
      {"a.xyz", "1 2 3\n4 5\n", {"has 2 columns, the first has 3"}, 2},
      {"a.xyz", "1 2 3\n4 5 6x\n", {"'6x' is not a number"}, 2},
      {"a.csv", "1,5;2,5;3.5\n", {"'3.5'", "number"}, 1},
      {"a.csv", "0,05,1,5,2,05\n", {"0 | 05 | 1 | 5 | 2 | 05", "0.05 | 1.5 | 2.05", "semicolons"}, 1},
      {"a.csv", "x,y,z\n1,5,2,5,3,5\n", {"6 columns", "names 3", "1.5 | 2.5 | 3.5"}, 2},
      {"a.ply", ply("1", end + "1,5 2 3\n"), {"'1,5'", "decimal points, not decimal commas"}, 8},
      {"a.obj", "v 1,5 2 3\n", {"'1,5'", "decimal points, not decimal commas"}, 1},
      {"a.off", "OFF\n1 0 0\n1,5 2 3\n", {"'1,5'", "decimal points, not decimal commas"}, 3},
      {"a.csv", "x,y,z\n", {"no points"}, 1},
      {"a.csv", "x,y,z\n1,2,3,4\n", {"4 columns", "names 3"}, 2},
      {"a.xyz", "0 0 0\n" + std::string((1u << 20) + 2, '1') + "\n", {"longer than"}, 2},
      {"a.xyz", "nan nan nan\ninf 0 0\n", {"none of the file's 2 points is finite"}, 0},
      {"a.xyz", "1e300 0 0\n-1e300 0 0\n", {"single precision"}, 0},
      {"a.obj", "# nothing\n", {"no vertices"}, 0},
      {"a.obj", "v 1 2\n", {"needs 3 coordinates", "has 2"}, 1},
      {"a.obj", "v 1 2 three\n", {"'three' is not a number"}, 1},
      {"a.obj", "v 1 2 3\nf 1 one 1\n", {"'one'", "not an index"}, 2},
      {"a.off", "PLY\n", {"no OFF file"}, 1},
      {"a.off", "4OFF\n1 0 0\n", {"three-dimensional"}, 1},
      {"a.off", "OFF BINARY\n", {"binary OFF"}, 1},
      {"a.off", "OFF\nmany 0 0\n", {"'many' is not a count"}, 2},
      {"a.off", "OFF\n1000000000000 0 0\n1 2 3\n", {"memory allowed"}, 0},
      {"a.off", "OFF\n9 0 0\n1 2 3\n", {"promises 9 vertices", "only 6 bytes"}, 2},
      {"a.off.gz", gzipped("OFF\n9 0 0\n1 2 3\n"), {"after 1 of the 9 promised vertices"}, 3},
      {"a.off", "OFF\n1 1 0\n1 2 3\n3 0 0\n", {"promises 3 corners and has 2"}, 4},

      {"a.las", "hello", {"no LAS file"}, 0},
      {"a.laz", "LASF", {"ends within its header, at byte 4", "cut short"}, 0},
      {"a.e57.gz", gzipped("ASTM-E57"), {"8 bytes", "at least 1024"}, 0},
      {"A.PTX", "1\n1\n", {"ten lines before scan 1"}, 2},
      {"a.stl", "solid\n", {"after 0 facets", "endsolid"}, 1},
      {"a.abc", "1\n", {"unknown file type '.abc'", "understood are"}, 0},
      {"noending", "1 2 3\n", {"no ending", "understood are"}, 0},
      {"a.xyz.gz", "1 2 3\n", {"named .gz", "not compressed"}, 0},
      {"a.xyz.gz", gzipped("1 2 3\n4 5 6\n").substr(0, 20), {"gzip data is cut off"}, 0},
      {"a.xyz.xz", xz_packed("1 2 3\n4 5 6\n").substr(0, 40), {"xz data is cut off"}, 0},
      {"a.xyz.gz", gzipped("1 2 3\n") + "garbage", {"gzip data is damaged"}, 0},
  };
}

TEST(Hostile, EachBadFileGetsItsMessage) {
  for (const Case& bad : text_cases()) {
    SCOPED_TRACE(fmt::format("{}: {:.60}", bad.name, bad.name.ends_with("z") ? "(compressed)" : bad.content));
    const Result<ReadModel> result = read_text(bad.content, bad.name);
    expect_named(result, bad.parts, bad.line);
    EXPECT_EQ(result ? "" : result.error().file, bad.name);
  }
}

TEST(Hostile, DamagedCompressedBytesAreSeen) {
  std::string text;
  for (int i = 0; i < 500; ++i) text += fmt::format("{} {} {}\n", i, i * i, i % 7);
  for (const bool xz : {false, true}) {
    std::string packed = xz ? xz_packed(text) : gzipped(text);
    packed[packed.size() / 2] = static_cast<char>(packed[packed.size() / 2] ^ 0x55);
    EXPECT_FALSE(read_text(packed, xz ? "a.xyz.xz" : "a.xyz.gz"));
  }
}

TEST(Hostile, DecompressionBombsStop) {
  // Past the 64 MiB from which the ratio counts.
  std::string blank(std::size_t{70} << 20, '#');
  for (std::size_t i = 100000; i < blank.size(); i += 100000) blank[i] = '\n';
  for (const bool xz : {false, true}) {
    const std::string packed = xz ? xz_packed(blank) : gzipped(blank);
    ASSERT_LT(packed.size(), std::size_t{1} << 20);
    const std::string name = xz ? "a.xyz.xz" : "a.xyz.gz";
    EXPECT_TRUE(test::refused(read_text(packed, name), "500 times"));
    ReadOptions small;
    small.max_bytes = std::uint64_t{1} << 20;
    EXPECT_TRUE(test::refused(read_text(packed, name, small), "1048576 bytes"));
  }
}

TEST(Hostile, WhatIsDecodedStaysWithinTheBound) {
  std::string text;
  for (int i = 0; i < 200000; ++i) text += "1 2 3\n";
  ReadOptions small;
  small.max_bytes = std::uint64_t{2} << 20;  // 200,000 points take 4.8 MB
  EXPECT_TRUE(test::refused(read_text(text, "a.xyz", small), "memory allowed"));
}

class HostileFiles : public InFolder {
 protected:
  HostileFiles() { add_standard_readers(readers_); }
  Readers readers_;
};

TEST_F(HostileFiles, PathsThatAreNoFiles) {
  EXPECT_TRUE(test::refused(readers_.read(in("none.ply"), {}), "none.ply: no such file"));
  std::filesystem::create_directories(in("folder.ply"));
  EXPECT_TRUE(test::refused(readers_.read(in("folder.ply"), {}), "folder"));
  write_text(in("closed.ply"), "ply\n");
  std::filesystem::permissions(in("closed.ply"), std::filesystem::perms::none);
  // Root reads everything, and finds no points.
  EXPECT_TRUE(test::refused(readers_.read(in("closed.ply"), {}), geteuid() != 0 ? "permissions" : ""));
}

// More than is allowed is refused before it is read where the size is known, and soon after where it is not.
TEST(Hostile, WholeFilesStayWithinTheBound) {
  struct Counted final : ByteSource {
    explicit Counted(std::optional<std::uint64_t> said) : left(said) {}
    Result<std::size_t> read(std::span<std::byte> out) override {
      given += out.size();
      return out.size();
    }
    std::optional<std::uint64_t> remaining() const override { return left; }
    double fraction() const override { return 0.0; }
    std::optional<std::uint64_t> left;
    std::uint64_t given = 0;
  };
  constexpr std::uint64_t kBound = 10'000'000;
  Counted said(std::uint64_t{1} << 40), unsaid(std::nullopt);
  for (Counted* source : {&said, &unsaid})
    EXPECT_TRUE(test::refused(read_all(*source, kBound), "--memory-limit-gb 0.01"));
  EXPECT_EQ(said.given, 0u);
  EXPECT_LT(unsaid.given, 2 * kBound);
  const std::string text(kBound, 'x');
  for (const std::string& whole : {text, gzipped(text)}) {
    auto source = test::value_of(open_maybe_compressed(
        std::make_unique<MemorySource>(std::as_bytes(std::span(whole))), DecompressionLimits{}));
    const auto read = test::value_of(read_all(*source, kBound));
    EXPECT_EQ(read.size(), text.size());
    EXPECT_EQ(std::memcmp(read.data(), text.data(), text.size()), 0);
  }
}

TEST(Hostile, NumbersOfTheOptionsAreFinite) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double bad : {nan, -1.0, std::numeric_limits<double>::infinity()}) {
    ReadOptions scale, post, vertical;
    scale.scale = bad;
    post.post_mm = bad;
    vertical.vertical_mm = bad;
    for (const ReadOptions& options : {scale, post, vertical})
      EXPECT_FALSE(read_text("Pf\n2 2\n-1\n" + std::string(16, '\0'), "a.pfm", options)) << bad;
  }
}

TEST(Hostile, WhatIsOfGridsIsRefusedForOtherFiles) {
  ReadOptions post, vertical;
  post.post_mm = 2.0;
  vertical.vertical_mm = 2.0;
  const std::string grid = "Pf\n2 2\n-1\n" + std::string(16, '\0');
  for (const auto& [options, says] : {std::pair(post, "--post-mm"), std::pair(vertical, "--vertical-mm")}) {
    EXPECT_TRUE(read_text(grid, "a.pfm", options));
    EXPECT_TRUE(test::refused(read_text("1 2 3\n4 5 6\n", "a.xyz", options), says));
  }
}

std::string pcd(const std::string& width, const std::string& height, const std::string& points,
                const std::string& data,
                const std::string& fields = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n") {
  return "# .PCD v0.7\nVERSION 0.7\n" + fields + "WIDTH " + width + "\nHEIGHT " + height +
         "\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + points + "\nDATA " + data + "\n";
}

Result<PcdHeader> checked(const std::string& content) {
  return check_pcd(std::as_bytes(std::span(content)), {});
}

TEST(Hostile, PcdHeadersAreCheckedAgainstTheFile) {
  const std::string sizes("\x0A\0\0\0\x0C\0\0\0", 8);  // 10 bytes unpack to 12: one point of three floats
  const std::vector<std::pair<std::string, std::string>> cases{
      {"hello\n", "unknown keyword 'hello'"},
      {"# only\n", "no DATA line"},
      {pcd("1", "1", "1", "morse"), "'morse' is not"},
      {pcd("2", "2", "5", "ascii"), "POINTS is 5, but WIDTH x HEIGHT is 4"},
      {pcd("-1", "1", "1", "ascii"), "whole number"},
      {pcd("0", "1", "0", "ascii"), "no points"},
      {pcd("4000000000", "4000000000", "1", "binary"), "more than can be told apart"},
      {pcd("1000000000", "1", "1000000000", "binary"), "2 GiB"},
      {pcd("50000000", "1", "50000000", "binary"), "only 0 bytes follow"},
      {pcd("1", "1", "1", "ascii", "FIELDS x y\nSIZE 4 4\nTYPE F F\nCOUNT 1 1\n"), "x, y and z"},
      {pcd("1", "1", "1", "ascii", "FIELDS x y z\nSIZE 4 4\nTYPE F F F\nCOUNT 1 1 1\n"),
       "differ in their number"},
      {pcd("1", "1", "1", "ascii", "FIELDS x y z\nSIZE 4 4 3\nTYPE F F F\nCOUNT 1 1 1\n"),
       "do not go together"},
      {pcd("1", "1", "1", "ascii", "FIELDS x y z w\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 99999999\n"),
       "count"},
      {pcd("2", "1", "2", "ascii") + "1 2 3\n4 5\n", "only 10 bytes follow"},
      {pcd("2", "1", "2", "ascii") + "1 2 3\n41 51\n6 7 8\n", "has 2 values"},
      {pcd("2", "1", "2", "ascii") + "1 2 3\n4 five 6\n", "'five' is not a number"},
      {pcd("2", "1", "2", "ascii") + "1 2 3\n        \n", "after 1 of the 2 promised"},
      {pcd("2", "1", "2", "binary") + std::string(23, 'a'), "only 23 bytes follow"},
      {pcd("1", "1", "1", "binary_compressed") + "abc", "only 3 bytes follow"},
      {pcd("1", "1", "1", "binary_compressed") + sizes + "abc", "only 3 follow"},
      {pcd("2", "1", "2", "binary_compressed") + sizes + "abcdefghij", "the header promises 24"},
      {pcd("1000", "1", "1000", "binary_compressed") + std::string("\x0A\0\0\0\xE0\x2E\0\0", 8) +
           "abcdefghij",
       "cannot unpack to 12000"},
  };
  for (const auto& [content, part] : cases) {
    SCOPED_TRACE(content);
    EXPECT_TRUE(test::refused(checked(content), part));
  }
}

TEST(Hostile, PcdFieldsOfNoValuesArePadding) {
  const std::string fields = "FIELDS x _ y z\nSIZE 4 1 4 4\nTYPE F U F F\nCOUNT 1 0 1 1\n";
  const auto header = test::value_of(checked(pcd("1", "1", "1", "ascii", fields) + "1 2 3\n"));
  EXPECT_EQ(header.fields.size(), 3u);
  EXPECT_EQ(header.point_bytes, 12u);
  EXPECT_FALSE(checked(pcd("1", "1", "1", "ascii", "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 -1 1\n") +
                       "1 2 3\n"));
}

TEST(Hostile, PcdHeadersMayBeginWithAByteOrderMark) {
  const std::string content = pcd("1", "1", "1", "ascii") + "1 2 3\n";
  const auto plain = test::value_of(checked(content)),
             header = test::value_of(checked("\xEF\xBB\xBF" + content));
  EXPECT_EQ(header.canonical, plain.canonical);
  EXPECT_EQ(header.body_at, plain.body_at + 3);
  EXPECT_TRUE(test::refused(checked(std::string("\xFE\xFF\0V", 4)), "UTF-16"));
}

// Everything that fuzzing starts from and has found: an Error or a model, never a crash.
TEST(Hostile, CorpusReplays) {
  const std::vector<std::pair<std::string, std::string>> folders{
      {"ply", "a.ply"}, {"xyz", "a.xyz"},     {"obj", "a.obj"},   {"off", "a.off"},
      {"pfm", "a.pfm"}, {"gzip", "a.xyz.gz"}, {"xz", "a.xyz.xz"}, {"e57", "a.e57"},
      {"ptx", "a.ptx"}, {"pts", "a.pts"},     {"stl", "a.stl"}};
  const auto files_in = [](const std::string& folder) {
    return std::filesystem::directory_iterator(std::string(PALPATE_CORPUS) + "/" + folder);
  };
  std::size_t files = 0, models = 0;
  for (const auto& [folder, name] : folders)
    for (const auto& entry : files_in(folder)) {
      const Result<ReadModel> model = read_text(file_text(entry.path()), name);
      EXPECT_FALSE(model ? model->cloud.empty() : model.error().what.empty()) << entry.path();
      models += model.ok();
      ++files;
    }
  for (const auto& entry : files_in("pcd")) {
    models += checked(file_text(entry.path())).ok();
    ++files;
  }
  EXPECT_GE(files, 40u);
  EXPECT_GE(models, 15u);
}

// Real scans from $PALPATE_DATA, against what is known of each.

struct Scan {
  const char* file;
  std::size_t points, faces, properties;
  Unit unit;
  double extent_x_mm;
};

TEST(Scans, AreReadWhole) {
  const std::vector<Scan> scans{
      {"stanford/dragon_vrip.ply.gz", 437645, 871414, 0, Unit::kMetre, 204.89},
      {"stanford/dragon_vrip_res2.ply.gz", 100250, 202520, 0, Unit::kMetre, 204.594},
      {"stanford/dragon_vrip_res3.ply.gz", 22998, 47794, 0, Unit::kMetre, 203.656},
      {"stanford/dragon_vrip_res4.ply.gz", 5205, 11102, 0, Unit::kMetre, 202.821},
      {"stanford/bun_zipper.ply.xz", 35947, 69451, 2, Unit::kMetre, 155.699},
      // Raw scans say the row and column of each point.
      {"stanford/bunny_range/bun000.ply.xz", 40256, 0, 2, Unit::kMetre, 155.75},
      {"stanford/bunny_range/ear_back.ply.xz", 32193, 0, 2, Unit::kMetre, 190.5},
      {"stanford/bunny_range_merged.ply.xz", 362272, 0, 3, Unit::kMetre, 175.647},
      {"stanford/dragon_stand_merged.ply.xz", 469193, 0, 3, Unit::kMetre, 247.731},
      {"lidar/lone-star.ply.xz", 518862, 0, 1, Unit::kMetre, 32440.8},
      // A street scan in metres of 73 m: the guess takes it for a 73 mm object, and says so.
      {"lidar/small_gicp_source.ply.xz", 69792, 0, 1, Unit::kMillimetre, 42.239}};
  Readers readers;
  add_standard_readers(readers);
  std::size_t found = 0;
  for (const Scan& scan : scans) {
    const std::filesystem::path path = shared_data(scan.file);
    if (path.empty()) continue;
    ++found;
    SCOPED_TRACE(scan.file);
    const auto model = test::value_of(readers.read(path.string(), {}));
    EXPECT_EQ(model.cloud.size(), scan.points);
    EXPECT_EQ(model.non_finite, 0u);
    EXPECT_EQ(model.mesh ? model.mesh->triangles.size() : 0, scan.faces);
    EXPECT_EQ(model.dropped_faces, 0u);
    EXPECT_EQ(model.cloud.properties.size(), scan.properties);
    EXPECT_EQ(model.unit, scan.unit);
    EXPECT_TRUE(model.unit_guessed);
    EXPECT_NEAR(model.cloud.box_mm().extent_mm().x(), scan.extent_x_mm, 1e-5 * scan.extent_x_mm);
    EXPECT_FALSE(model.cloud.raster);
  }
  if (found == 0) GTEST_SKIP() << "none of the scans is under PALPATE_DATA";
}

}  // namespace
}  // namespace palpate::io
