// Reading files of cells: boxes, streams, and files that are damaged or made to harm.
#include <gtest/gtest.h>

#include <cstring>
#include <memory>

#include <palpate/cloud.h>
#include "tests/toolkit/prepared/prepared_points.h"
#include "toolkit/core/bytes.h"
#include "toolkit/core/hash.h"

namespace palpate::prepared::test {
namespace {

using palpate::test::refused;
using palpate::test::value_of;

class CellFiles : public Prepared {
 protected:
  /// A small file of several cells.
  std::string made() {
    PrepareCellsOptions options;
    options.quantum_mm = 2e-4;
    (void)prepare(Sheet::make(40, 0.3, {5.0, 6.0, 7.0}, 11).points, options);
    return bytes();
  }
  static std::uint64_t number_at(const std::string& text, std::size_t at) {
    return ByteReader(std::as_bytes(std::span(text).subspan(at, sizeof(std::uint64_t)))).u64();
  }
  static void put(std::string& text, std::size_t at, std::uint64_t number) {
    ByteWriter(std::as_writable_bytes(std::span(text).subspan(at, sizeof(number)))).u64(number);
  }
  static std::uint64_t hash_of(std::string_view text) {
    Hash64 hash;
    hash.bytes(std::as_bytes(std::span(text)));
    return hash.value();
  }
  /// Places of the table's offset and hash in the header.
  static constexpr std::size_t kTableOffsetAt = 48, kTableHashAt = 56;
  static std::size_t table_of(const std::string& text) {
    return static_cast<std::size_t>(number_at(text, kTableOffsetAt));
  }
  /// Hashes that agree with what was changed.
  static void sign(std::string& text) {
    put(text, kTableHashAt, hash_of(std::string_view(text).substr(table_of(text))));
    sign_header(text);
  }
  static void sign_header(std::string& text) {
    const std::size_t end = kCellHeaderBytes - sizeof(std::uint64_t);
    put(text, end, hash_of(std::string_view(text).substr(0, end)));
  }
  /// Reads all of a file, and gives the first Error.
  Status read_all(const std::string& name) const {
    PALPATE_ASSIGN(const CellFile file, CellFile::open(in(name)));
    for (std::size_t cell = 0; cell < file.size(); ++cell) PALPATE_TRY(file.read_cell(cell));
    return Done{};
  }
};

TEST_F(CellFiles, AllDamageIsFoundAndNamed) {
  const std::string whole = made();
  const std::size_t table = table_of(whole);
  write("signed", whole);
  ASSERT_TRUE(read_all("signed").ok());
  constexpr std::size_t kStep = 37;  // no divisor of a line or a point
  for (std::size_t at = 0; at < whole.size(); at += kStep) {
    std::string changed = whole;
    changed[at] = static_cast<char>(changed[at] ^ 0x10);
    write("changed", changed);
    const Status read = read_all("changed");
    ASSERT_TRUE(refused(read, "changed", "again")) << at;
    if (at >= kCellHeaderBytes && at < table) {
      EXPECT_TRUE(refused(read, "cell ", "damaged"));
    }
  }
  for (std::size_t length = 0; length < whole.size(); length += 4 * kStep) {
    write("cut", whole.substr(0, length));
    ASSERT_TRUE(refused(CellFile::open(in("cut")), "cut", "again")) << length;
  }
  write("long", whole + "x");
  EXPECT_TRUE(refused(CellFile::open(in("long"))));
  EXPECT_TRUE(refused(CellFile::open(in("none")), "no such file"));
  EXPECT_TRUE(refused(open().read_cell(open().size()), "there is no cell"));
}

TEST_F(CellFiles, ADamagedCellLeavesTheOthers) {
  std::string text = made();
  ASSERT_GT(open().size(), 3u);
  const std::size_t at = static_cast<std::size_t>(open().entry(2).offset);
  text[at] = static_cast<char>(text[at] + 1);
  write("cells", text);
  const CellFile file = open();
  for (std::size_t cell = 0; cell < file.size(); ++cell) {
    const auto points = file.read_cell(cell);
    EXPECT_EQ(points.ok(), cell != 2);
    if (!points) {
      EXPECT_TRUE(refused(points, "cells: cell 2 of ", "damaged; prepare the points again"));
    }
  }
}

class PartOfCells : public CellFiles {
 protected:
  /// A file of many cells.
  CellFile many() {
    PrepareCellsOptions options;
    options.quantum_mm = 1e-4;
    (void)prepare(Sheet::make(200, 0.3, {5.0, 6.0, 7.0}, 12).points, options);
    return open();
  }
  static Result<cloud::Cloud> part(const CellFile& file, const std::optional<geometry::Aabb>& box,
                                   std::uint64_t max_bytes = kMemoryLimitBytes) {
    return read_cloud(file, box, max_bytes, no_progress());
  }
};

TEST_F(PartOfCells, HasJustThePointsOfTheClosedBox) {
  const CellFile file = many();
  ASSERT_GT(file.size(), 10u);
  std::vector<Vec3> all;
  for (std::size_t cell = 0; cell < file.size(); ++cell) {
    const CellPoints points = value_of(file.read_cell(cell));
    all.insert(all.end(), points.own_mm().begin(), points.own_mm().end());
  }
  const auto as_cloud = [](const std::vector<Vec3>& points) {
    return cloud::content_hash(value_of(cloud::build_cloud(points, cloud::NonFinite::kRefuse)));
  };
  EXPECT_EQ(cloud::content_hash(value_of(part(file, std::nullopt))), as_cloud(all));
  constexpr std::uint64_t kSeed = 21;
  SCOPED_TRACE(kSeed);
  Random random(kSeed);
  for (int i = 0; i < 60; ++i) {
    // Points of the file are its corners: they are within.
    const Vec3 a = all[random.below(all.size())], b = all[random.below(all.size())];
    geometry::Aabb box{a.cwiseMin(b), a.cwiseMax(b)};
    if (i % 2 == 0) box.low_mm.z() = -1e6, box.high_mm.z() = 1e6;
    std::vector<Vec3> inside;
    for (const Vec3& p : all)
      if (box.contains(p)) inside.push_back(p);
    ASSERT_EQ(cloud::content_hash(value_of(part(file, box))), as_cloud(inside)) << i;
  }
}

TEST_F(PartOfCells, NoOtherCellIsRead) {
  std::vector<std::size_t> offset_of_others;
  std::size_t cell = 0, offset = 0;
  geometry::Aabb box;
  {
    const CellFile file = many();
    cell = file.size() / 2;
    offset = static_cast<std::size_t>(file.entry(cell).offset);
    box = file.box_mm(cell);
    for (std::size_t other = 0; other < file.size(); ++other)
      if (!box.overlaps(file.box_mm(other)))
        offset_of_others.push_back(static_cast<std::size_t>(file.entry(other).offset));
  }
  ASSERT_GT(offset_of_others.size(), 5u);
  const std::string whole = bytes();
  std::string text = whole;
  const std::uint64_t sound = cloud::content_hash(value_of(part(open(), box)));
  for (const std::size_t at : offset_of_others) text[at] = static_cast<char>(text[at] ^ 1);
  write("cells", text);
  EXPECT_EQ(cloud::content_hash(value_of(part(open(), box))), sound);
  EXPECT_TRUE(refused(part(open(), std::nullopt), "is damaged"));
  text[offset] = static_cast<char>(text[offset] ^ 1);
  write("cells", text);
  EXPECT_TRUE(refused(part(open(), box), "cells: cell " + std::to_string(cell) + " of ", "is damaged"));
}

TEST_F(PartOfCells, WhatIsTooLargeOrEmptyIsRefused) {
  const CellFile file = many();
  const geometry::Aabb box = file.box_mm(0);
  const std::uint64_t too_few = 36 * (file.info().points - 1);
  EXPECT_TRUE(refused(part(file, std::nullopt, too_few), "cells: ", "bytes of memory", "--within X,Y,Z",
                      "within_mm", "--memory-limit-gb"));
  EXPECT_TRUE(part(file, box, too_few).ok());
  EXPECT_TRUE(refused(part(file, geometry::Aabb{{-2, -2, -2}, {-1, -1, -1}}),
                      "cells: no point is within (-2, -2, -2) to (-1, -1, -1) mm",
                      "the points are within ("));
}

TEST_F(CellFiles, ImpossibleNumbersWithRightHashesAreRefused) {
  const std::string whole = made();
  std::string same = whole;
  sign(same);
  ASSERT_TRUE(same == whole) << "this test knows the layout";
  const std::uint64_t far = ~std::uint64_t{0};
  const std::size_t table = table_of(whole);
  // Places in the second line of the table.
  const std::size_t line = table + kCellEntryBytes;
  const struct {
    std::size_t at;
    std::uint64_t number;
  } changes[] = {
      {16, 0},    // points
      {32, 0},    // halo points
      {40, far},  // cells
      {40, far / kCellEntryBytes},
      {kTableOffsetAt, far},  // the table's offset
      {kTableOffsetAt, table + kCellEntryBytes},
      {64, far >> 1},                                  // the lattice's exponent
      {72, 0x7FF0000000000000u},                       // the lattice's corner: infinite
      {line, 0},                                       // a key before the last one's
      {line + 16, 127},                                // depth; no points
      {line + 16, std::uint64_t{1} << 32 | 43u << 8},  // quantum
      {line + 24, far},                                // halo
      {line + 32, 0},                                  // offset
      {line + 32, far},
      {line + 40, far},  // low
      {line + 64, 0},    // high
      {line + 64, far},
      {line + 88, far},                   // base
      {line + 112, 0x7FF8000000000000u},  // the halo's distance: not a number
  };
  for (const auto& change : changes) {
    std::string text = whole;
    put(text, change.at, change.number);
    change.at == kTableOffsetAt ? sign_header(text) : sign(text);
    write("hostile", text);
    EXPECT_TRUE(refused(CellFile::open(in("hostile")), "hostile", "prepare the points again"))
        << change.at << ": " << change.number;
  }
}

/// Files of an earlier day: what the layout's version promises. The fuzzer begins with them.
TEST(CellCorpus, IsReadAsItWasWritten) {
  const std::string folder = PALPATE_CORPUS;
  EXPECT_EQ(value_of(CellFile::open(folder + "/no_points.cells")).size(), 0u);
  const CellFile two = value_of(CellFile::open(folder + "/two_points.cells"));
  ASSERT_EQ(two.size(), 1u);
  const CellPoints points = value_of(two.read_cell(0));
  ASSERT_EQ(points.own, 2u);
  EXPECT_LE((points.points_mm[0] - Vec3(1.0, 2.0, 3.0)).cwiseAbs().maxCoeff(), 0.5 * points.quantum_mm);
  EXPECT_LE((points.points_mm[1] - Vec3(4.0, 5.0, 7.0)).cwiseAbs().maxCoeff(), 0.5 * points.quantum_mm);
  const CellFile sheet = value_of(CellFile::open(folder + "/small_sheet.cells"));
  EXPECT_GT(sheet.info().halo_points, 0u);
  for (std::size_t cell = 0; cell < sheet.size(); ++cell) EXPECT_TRUE(sheet.read_cell(cell).ok());
}

TEST_F(CellFiles, TakeFewBytesAPoint) {
  (void)prepare(Sheet::make(90, 0.3, {5.0, 6.0, 7.0}, 15).points, {});
  EXPECT_LT(open().bytes_per_point(), 8.0);
  EXPECT_GT(open().bytes_per_point(), static_cast<double>(kBytesPerPoint));
}

}  // namespace
}  // namespace palpate::prepared::test
