// STL meshes in both forms: what they hold, how they are told apart, and files that are damaged.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cctype>
#include <cmath>
#include <limits>

#include "compress.h"
#include "e57_writer.h"
#include "tests/toolkit/messages.h"
#include "toolkit/io/decoding.h"

namespace palpate::io {
namespace {

using Facet = std::array<Vec3, 3>;

Result<DecodedFile> decode_stl(const std::string& file, std::uint64_t max_bytes = kMemoryLimitBytes) {
  return decode(read_stl, file, max_bytes);
}

std::string binary_stl(const std::vector<Facet>& facets, const std::string& comment = "by a test") {
  std::string file = comment;
  file.resize(80, ' ');
  file += little(facets.size(), 4);
  const auto add = [&](const Vec3& v) {
    for (int axis = 0; axis < 3; ++axis)
      file += little(std::bit_cast<std::uint32_t>(static_cast<float>(v[axis])), 4);
  };
  for (const Facet& facet : facets) {
    add({0, 0, 1});
    for (const Vec3& corner : facet) add(corner);
    file += "\x12\x34";
  }
  return file;
}

std::string text_stl(const std::vector<Facet>& facets, const std::string& end = "\n") {
  std::string file = "solid part of a test" + end;
  for (const Facet& facet : facets) {
    file += "  facet normal 0 0 1" + end + "    outer loop" + end;
    for (const Vec3& corner : facet)
      file += fmt::format("      vertex {:e} {:e} {:e}", corner.x(), corner.y(), corner.z()) + end;
    file += "    endloop" + end + "  endfacet" + end;
  }
  return file + "endsolid part of a test" + end;
}

// A tetrahedron, whose four corners stand in three facets each.
const std::vector<Vec3> kCorners{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0.5, 0.25, 1}};
const std::vector<std::array<std::uint32_t, 3>> kTriangles{{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};

std::vector<Facet> tetrahedron() {
  std::vector<Facet> facets;
  for (const auto& [a, b, c] : kTriangles) facets.push_back({kCorners[a], kCorners[b], kCorners[c]});
  return facets;
}

void expect_tetrahedron(const DecodedFile& decoded) {
  ASSERT_EQ(decoded.points.size(), kCorners.size());
  ASSERT_EQ(decoded.triangles.size(), kTriangles.size());
  EXPECT_EQ(decoded.continues_face, std::vector<bool>(kTriangles.size(), false));
  for (std::size_t t = 0; t < kTriangles.size(); ++t)
    for (std::size_t c = 0; c < 3; ++c)
      EXPECT_EQ(decoded.points[decoded.triangles[t][c]], kCorners[kTriangles[t][c]]) << "facet " << t;
  EXPECT_EQ(decoded.dropped_faces, 0u);
}

TEST(Stl, EqualCornersAreOneVertexInBothForms) {
  const DecodedFile binary = test::value_of(decode_stl(binary_stl(tetrahedron())));
  expect_tetrahedron(binary);
  EXPECT_EQ(binary.format, "STL, binary");
  EXPECT_TRUE(binary.single_precision);
  EXPECT_FALSE(binary.unit || binary.conventional_unit);
  for (const char* end : {"\n", "\r\n"}) {
    const DecodedFile text = test::value_of(decode_stl(text_stl(tetrahedron(), end)));
    expect_tetrahedron(text);
    EXPECT_EQ(text.format, "STL, ASCII");
    EXPECT_FALSE(text.single_precision);
  }
  std::string loud = text_stl(tetrahedron());
  for (char& c : loud) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  expect_tetrahedron(test::value_of(decode_stl(loud)));
  expect_tetrahedron(test::value_of(decode_stl(text_stl({}) + text_stl(tetrahedron()))));
}

TEST(Stl, TheSizeTellsBinaryFilesThatBeginWithSolid) {
  const DecodedFile decoded = test::value_of(decode_stl(binary_stl(tetrahedron(), "solid facet")));
  expect_tetrahedron(decoded);
  EXPECT_EQ(decoded.format, "STL, binary");
}

TEST(Stl, NearCornersStayApartAndBadFacetsAreCounted) {
  std::vector<Facet> facets = tetrahedron();
  facets[1][0].x() = static_cast<double>(std::numeric_limits<float>::denorm_min());
  EXPECT_EQ(test::value_of(decode_stl(binary_stl(facets))).points.size(), 5u);
  facets = tetrahedron();
  facets.push_back({kCorners[0], kCorners[1], kCorners[1]});
  facets.push_back({kCorners[0], kCorners[1], Vec3(0, std::nan(""), 0)});
  for (const std::string& file : {binary_stl(facets), text_stl(facets)}) {
    const DecodedFile decoded = test::value_of(decode_stl(file));
    EXPECT_EQ(decoded.points.size(), 4u);
    EXPECT_EQ(decoded.triangles.size(), 4u);
    EXPECT_EQ(decoded.dropped_faces, 2u);
  }
}

TEST(Stl, SurplusBytesAreSaid) {
  const DecodedFile decoded = test::value_of(decode_stl(binary_stl(tetrahedron()) + "abc"));
  expect_tetrahedron(decoded);
  ASSERT_EQ(decoded.warnings.size(), 1u);
  EXPECT_TRUE(test::contains(decoded.warnings[0], "3 bytes follow the last facet"));
}

TEST(StlHostile, EachWrongThingIsNamed) {
  struct Bad {
    std::string file;
    std::vector<std::string> parts;
    std::int64_t line;
  };
  std::string many = binary_stl(tetrahedron());
  many.replace(80, 4, little(0xFFFFFFFFu, 4));
  const std::string head = "solid\nfacet normal 0 0 1\n", corner = "vertex 1 2 3\n";
  const Bad cases[] = {
      {"short", {"5 bytes", "solid"}, 0},
      {many, {"promises 4294967295 facets", "4 fit"}, 0},
      {binary_stl({}), {"no facets"}, 0},
      {"solid nothing\nendsolid\n", {"no facets"}, 0},
      {head + "facet\n", {"begins within another"}, 3},
      {"solid\n" + corner, {"outside of a facet"}, 2},
      {head + corner + corner + corner + corner, {"more than three"}, 6},
      {head + corner + corner + "endfacet\n", {"2 corners"}, 5},
      {"solid\nendfacet\n", {"not begun"}, 2},
      {head + "vertex 1 2\n", {"3 coordinates", "has 2"}, 3},
      {head + "vertex 1 two 3\n", {"'two' is not a number"}, 3},
      {head + "vertices\n", {"'vertices'"}, 3},
      {head + corner, {"within a facet"}, 3},
      {head + corner + corner + corner + "endfacet\n", {"after 1 facets", "endsolid"}, 6},
  };
  for (const Bad& bad : cases) {
    SCOPED_TRACE(bad.parts.front());
    expect_named(decode_stl(bad.file), bad.parts, bad.line);
  }
  EXPECT_TRUE(test::refused(decode_stl(binary_stl(tetrahedron()), 500), "memory"));
}

TEST(StlHostile, TruncationsAndFlipsGiveFacetsOrErrors) {
  const std::string binary = binary_stl(tetrahedron()), text = text_stl(tetrahedron());
  const auto refused = [](const std::string& cut) { EXPECT_FALSE(decode_stl(cut)); };
  test::each_cut(binary, binary.size(), refused);
  test::each_cut(text, text.size() - std::string("endsolid part of a test\n").size(), refused);
  const auto facets_or_error = [](const std::string& wrong) {
    const Result<DecodedFile> decoded = decode_stl(wrong, std::uint64_t{1} << 20);
    EXPECT_TRUE(decoded || !decoded.error().what.empty());
    if (!decoded) return;
    EXPECT_LE(decoded->triangles.size() + decoded->dropped_faces, kTriangles.size());
    for (const auto& triangle : decoded->triangles)
      for (const std::uint32_t corner : triangle) EXPECT_LT(corner, decoded->points.size());
  };
  for (const std::string& file : {binary, text})
    test::each_flip(file, {0x01, 0x10, 0x80, 0xFF}, facets_or_error);
}

}  // namespace
}  // namespace palpate::io
