// The same seeded points and faces through every format and compression: the same doubles, bit for bit.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "compress.h"
#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/random.h"

namespace palpate::io {
namespace {

constexpr std::uint64_t kSeed = 20260101;
constexpr std::size_t kPoints = 150, kFaces = 60;
const std::string kFloats = "property float x\nproperty float y\nproperty float z\nend_header\n";

struct Sample {
  std::vector<Vec3> points;
  std::vector<std::array<std::uint32_t, 3>> faces;
  std::vector<float> weight;
};

Sample make_sample() {
  Random random(kSeed);
  Sample sample;
  for (std::size_t i = 0; i < kPoints; ++i) {
    sample.points.emplace_back(random.uniform(-100, 100), random.uniform(-1, 1), random.uniform(0, 1e-3));
    sample.weight.push_back(static_cast<float>(random.uniform()));
  }
  for (std::size_t i = 0; i < kFaces; ++i) {
    const auto corner = [&] { return static_cast<std::uint32_t>(random.below(kPoints)); };
    sample.faces.push_back({corner(), corner(), corner()});
  }
  return sample;
}

template <class T>
void put(std::string& out, T value, bool big) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  if (big) std::reverse(bytes, bytes + sizeof(T));
  out.append(bytes, sizeof(T));
}

std::string ply_ascii(const Sample& s) {
  std::string out = fmt::format(
      "ply\nformat ascii 1.0\ncomment hand made\nelement vertex {}\nproperty double x\nproperty double y\n"
      "property double z\nproperty float weight\nelement face {}\nproperty list uchar int "
      "vertex_indices\nend_header\n",
      s.points.size(), s.faces.size());
  for (std::size_t i = 0; i < s.points.size(); ++i)
    out += fmt::format("{:.17g} {:.17g} {:.17g} {:.9g}\n", s.points[i].x(), s.points[i].y(), s.points[i].z(),
                       s.weight[i]);
  for (const auto& f : s.faces) out += fmt::format("3 {} {} {} \n", f[0], f[1], f[2]);
  return out;
}

// Odd order, an element in front, lists in the vertices where asked for, other names for types.
std::string ply_binary(const Sample& s, bool big, bool lists) {
  std::string out = fmt::format(
      "ply\nformat binary_{}_endian 1.0\nelement camera 1\nproperty int16 a\nproperty list uint8 float32 b\n"
      "element vertex {}\nproperty uchar flag\nproperty float64 z\n{}property float weight\n"
      "property double x\nproperty double y\nelement face {}\n"
      "property uchar kind\nproperty list int32 uint vertex_index\n"
      "property list uchar float texcoord\nend_header\n",
      big ? "big" : "little", s.points.size(), lists ? "property list ushort short tags\n" : "",
      s.faces.size());
  put<std::int16_t>(out, 7, big);
  put<std::uint8_t>(out, 2, big);
  put<float>(out, 1.0F, big);
  put<float>(out, 2.0F, big);
  for (std::size_t i = 0; i < s.points.size(); ++i) {
    put<std::uint8_t>(out, 200, big);
    put<double>(out, s.points[i].z(), big);
    if (lists) {
      put<std::uint16_t>(out, static_cast<std::uint16_t>(i % 3), big);
      for (std::size_t k = 0; k < i % 3; ++k) put<std::int16_t>(out, -5, big);
    }
    put<float>(out, s.weight[i], big);
    put<double>(out, s.points[i].x(), big);
    put<double>(out, s.points[i].y(), big);
  }
  for (const auto& f : s.faces) {
    put<std::uint8_t>(out, 1, big);
    put<std::int32_t>(out, 3, big);
    for (const std::uint32_t corner : f) put<std::uint32_t>(out, corner, big);
    put<std::uint8_t>(out, 1, big);
    put<float>(out, 0.5F, big);
  }
  return out;
}

std::string columns(const Sample& s, const std::string& separator, const std::string& header) {
  std::string out = "# by hand\n" + header;
  for (std::size_t i = 0; i < s.points.size(); ++i)
    out += fmt::format("{1:.17g}{0}{2:.17g}{0}{3:.17g}{0}{4:.9g}\r\n", separator, s.points[i].x(),
                       s.points[i].y(), s.points[i].z(), s.weight[i]);
  return out;
}

std::string obj(const Sample& s) {
  std::string out = "# by hand\nmtllib none.mtl\no thing\n";
  for (const Vec3& p : s.points) out += fmt::format("v {:.17g} {:.17g} {:.17g}\n", p.x(), p.y(), p.z());
  out += "vt 0 0\nvn 0 0 1\n";
  const auto n = static_cast<long long>(s.points.size());
  for (std::size_t i = 0; i < s.faces.size(); ++i) {
    const auto& f = s.faces[i];
    if (i % 4 == 0) out += fmt::format("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1);
    if (i % 4 == 1) out += fmt::format("f {}/1 {}/1 {}/1\n", f[0] + 1, f[1] + 1, f[2] + 1);
    if (i % 4 == 2) out += fmt::format("f {}//1 {}//1 {}//1\n", f[0] + 1, f[1] + 1, f[2] + 1);
    if (i % 4 == 3) out += fmt::format("f {}/1/1 {}/1/1 {}/1/1\n", f[0] - n, f[1] - n, f[2] - n);
  }
  return out;
}

std::string off(const Sample& s, bool colours) {
  std::string out =
      fmt::format("{}\n# by hand\n\n{} {} 0\n", colours ? "COFF" : "OFF", s.points.size(), s.faces.size());
  for (const Vec3& p : s.points)
    out +=
        fmt::format("{:.17g} {:.17g} {:.17g}{}\n", p.x(), p.y(), p.z(), colours ? " 255 0 0 255 # red" : "");
  for (const auto& f : s.faces) out += fmt::format("3 {} {} {} 0.5 0.5 0.5\n", f[0], f[1], f[2]);
  return out;
}

struct Format {
  std::string name, content;
  bool faces;
  std::string weight;  // the property that must carry Sample::weight, or empty
};

std::vector<Format> all_formats(const Sample& s) {
  return {{"ascii.ply", ply_ascii(s), true, "weight"},
          {"little.ply", ply_binary(s, false, false), true, "weight"},
          {"big.PLY", ply_binary(s, true, false), true, "weight"},
          {"lists_little.ply", ply_binary(s, false, true), true, "weight"},
          {"lists_big.ply", ply_binary(s, true, true), true, "weight"},
          {"blank.xyz", columns(s, "  ", ""), false, "column4"},
          {"counted.pts", columns(s, " ", fmt::format("{}\n", s.points.size())), false, "column4"},
          {"comma.csv", columns(s, ",", "X,Y,Z,Weight\n"), false, "weight"},
          {"semicolon.csv", columns(s, " ; ", "\"x\";\"y\";\"z\";\"weight\"\n"), false, "weight"},
          {"tab.txt", columns(s, "\t", ""), false, "column4"},
          {"faces.obj", obj(s), true, ""},
          {"plain.off", off(s, false), true, ""},
          {"colour.off", off(s, true), true, ""}};
}

std::uint64_t hash_of(const Sample& s) {
  Hash64 hash;
  for (const Vec3& p : s.points)
    for (const double x : p) hash.real(x);
  return hash.value();
}

TEST(Formats, EveryFormatAndCompressionGivesTheSameDoubles) {
  const Sample sample = make_sample();
  ReadOptions options;
  options.unit = Unit::kMillimetre;
  for (const Format& format : all_formats(sample)) {
    const std::array<std::pair<std::string, std::string>, 3> packed{
        {{"", format.content}, {".gz", gzipped(format.content)}, {".xz", xz_packed(format.content)}}};
    for (const auto& [ending, content] : packed) {
      SCOPED_TRACE(fmt::format("{}{}, seed {}", format.name, ending, kSeed));
      const ReadModel model = model_of(content, "folder.d/" + format.name + ending, options);
      EXPECT_EQ(model.compression, ending.empty() ? "" : ending == ".gz" ? "gzip" : "xz");
      EXPECT_EQ(model.cloud.size(), kPoints);
      EXPECT_EQ(model.content_hash, hash_of(sample));
      EXPECT_EQ(model.dropped_faces, 0u);
      EXPECT_FALSE(model.unit_guessed);
      ASSERT_EQ(model.mesh != nullptr, format.faces);
      if (format.faces) {
        EXPECT_EQ(model.mesh->triangles, sample.faces);
        EXPECT_EQ(model.mesh->vertices_mm, sample.points);
      }
      const auto carries = [&](const cloud::Property& property) {
        return property.name == format.weight && property.values == sample.weight;
      };
      EXPECT_TRUE(format.weight.empty() || std::ranges::any_of(model.cloud.properties, carries));
    }
  }
}

TEST(Formats, ColumnsMayStandInAnyOrderAndNameTheUnit) {
  const ReadModel model = model_of("label,z_m,x_m,y_m\nwood,3,1,2\nsteel,6,4,5\n", "a.csv");
  EXPECT_EQ(model.unit, Unit::kMetre);
  EXPECT_FALSE(model.unit_guessed);
  EXPECT_EQ(model.cloud.point_mm(0), Vec3(1000, 2000, 3000));
  EXPECT_TRUE(model.cloud.properties.empty());  // the labels are left out, with a warning
  EXPECT_EQ(model.warnings.size(), 1u);
  EXPECT_TRUE(warns(model, "label"));
}

using Triangles = std::vector<std::array<std::uint32_t, 3>>;

void expect_faces(const ReadModel& model, const Triangles& triangles, std::uint64_t dropped) {
  ASSERT_NE(model.mesh, nullptr);
  EXPECT_EQ(model.mesh->triangles, triangles);
  EXPECT_EQ(model.dropped_faces, dropped);
}

TEST(Formats, PolygonsBecomeFansAndBadOnesGoWhole) {
  const ReadModel model = model_of(
      "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 2 0\nf 1 2 3 4 5\nf 1 2 3 99\nf 0 1 2\nf 1 2\nf 2 3 4\n",
      "a.obj");
  expect_faces(model, {{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {1, 2, 3}}, 3);
}

ReadModel corpus_model(const std::string& name) {
  return model_of(file_text(std::string(PALPATE_CORPUS) + "/" + name), name);
}

// A strip turns every second triangle, so that all face the same way; -1 ends it. Corners that stand twice
// join strips and are no faces; a triangle with a point that is not there is dropped and counted.
TEST(Formats, StripsOfTrianglesGiveFaces) {
  const Triangles both{{0, 1, 2}, {2, 1, 3}, {2, 3, 4}, {4, 3, 5}};
  for (const char* name : {"ply/strips_little.ply", "ply/strips_big.ply"}) {
    SCOPED_TRACE(name);
    expect_faces(corpus_model(name), both, 0);
  }
  // Of the second strip, 0 1 2 2 4 4 5 99: its first triangle; four without area; (4, 5, 99) has no point.
  Triangles expected = both;
  expected.push_back({0, 1, 2});
  expect_faces(corpus_model("ply/strips.ply"), expected, 1);
}

TEST(Formats, RowsThatHoldMoreThanTheHeaderNamesAreReadWithAWarning) {
  const ReadModel ply = corpus_model("ply/longer_rows.ply");
  ASSERT_NE(ply.mesh, nullptr);
  EXPECT_EQ(ply.mesh->triangles, (Triangles{{0, 1, 2}, {2, 1, 0}}));
  for (const char* part : {"1 rows of element 'face'", "line 16", "1 rows of element 'camera'", "line 15"})
    EXPECT_TRUE(warns(ply, part)) << part;
  const ReadModel off = corpus_model("off/longer_rows.off");  // OFF itself lets colours follow
  ASSERT_NE(off.mesh, nullptr);
  EXPECT_EQ(off.mesh->triangles, (Triangles{{0, 1, 2}}));
}

TEST(Formats, FacesWithoutTheirListAreReportedAndTakeNoTime) {
  const ReadModel model = corpus_model("ply/faces_by_another_name.ply");
  EXPECT_EQ(model.mesh, nullptr);
  EXPECT_TRUE(warns(model, "'face' has no list vertex_indices"));
}

TEST(Formats, AnObjLineMayGoOnInTheNext) {
  const ReadModel model = corpus_model("obj/continued.obj");
  EXPECT_EQ(model.cloud.size(), 4u);               // a comment that ends with a backslash hides no vertex
  expect_faces(model, {{0, 1, 2}, {0, 2, 3}}, 1);  // the last line goes on in nothing
  const Result<ReadModel> bad = read_text("v 0 0 0\nf 1 \\\n1 \\\none\n", "a.obj");
  ASSERT_FALSE(bad);
  EXPECT_EQ(bad.error().line, 2);
  std::string endless = "v 0 0 0\nf";
  for (int i = 0; i < 1 << 20; ++i) endless += " 1\\\n";
  EXPECT_TRUE(test::refused(read_text(endless, "a.obj"), "continuations are longer"));
}

TEST(Formats, ConcatenatedCompressedStreamsAreOneFile) {
  for (const bool xz : {false, true}) {
    const auto pack = [&](const std::string& text) { return xz ? xz_packed(text) : gzipped(text); };
    const ReadModel model = model_of(pack("1 2 3\n4 5") + pack(" 6\n7 8 9\n"), xz ? "a.xyz.xz" : "a.xyz.gz");
    EXPECT_EQ(model.cloud.size(), 3u);
  }
}

// Windows editors put a mark before the text; PowerShell's redirection writes UTF-16.
TEST(Formats, AByteOrderMarkBelongsToNoFormat) {
  const std::pair<const char*, std::string> files[] = {
      {"a.ply", "ply\nformat ascii 1.0\nelement vertex 2\n" + kFloats + "1 2 3\n4 5 6\n"},
      {"a.obj", "v 1 2 3\nv 4 5 6\n"},
      {"a.off", "OFF\n2 0 0\n1 2 3\n4 5 6\n"},
      {"a.xyz", "1 2 3\n\n \n4 5 6\n\n"},
      {"a.csv", "x,y,z\n\n1,2,3\n\n4,5,6\n"},
      {"a.pts", "2\n1 2 3\n4 5 6\n"},
  };
  for (const auto& [name, text] : files) {
    SCOPED_TRACE(name);
    const ReadModel plain = model_of(text, name), marked = model_of("\xEF\xBB\xBF" + text, name);
    EXPECT_EQ(marked.file_points, 2u);
    EXPECT_EQ(marked.content_hash, plain.content_hash);
    std::string wide = "\xFF\xFE";
    for (const char c : text) wide += {c, '\0'};
    EXPECT_TRUE(test::refused(read_text(wide, name), "UTF-16; save it as UTF-8"));
  }
}

TEST(Formats, CompressionIsSeenWithoutItsEnding) {
  const ReadModel model = model_of(gzipped("1 2 3\n"), "a.xyz");
  EXPECT_EQ(model.compression, "gzip");
}

// Tables of text as surveyors and spreadsheets write them: names, units, decimal commas, line ends, rows.

void expect_point(const std::string& content, const Vec3& point, const std::string& name = "a.txt") {
  SCOPED_TRACE(content);
  ReadOptions options;
  options.unit = Unit::kMillimetre;
  const ReadModel model = model_of(content, name, options);
  EXPECT_EQ(model.cloud.point_mm(0), point);
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
  const ReadModel model = model_of("# x(cm) y(cm) z(cm)\n1 2 3\n", "a.txt");
  EXPECT_EQ(model.unit, Unit::kCentimetre);
  EXPECT_FALSE(model.unit_guessed);
}

TEST(Tables, ColumnsTakenWithoutNamesAreSaid) {
  const ReadModel model = model_of("7 1 2 3\n8 4 5 6\n", "a.txt");
  EXPECT_TRUE(test::contains(model.format, "columns 1, 2, 3 of 4; the first row is '7 1 2 3'"));
  EXPECT_TRUE(warns(model_of("a b c d\n7 1 2 3\n", "a.txt"), "(a, b, c)"));
}

TEST(Tables, DecimalCommasAreToldFromSeparators) {
  const Vec3 point(1.5, -2.5, 3);
  expect_point("1,5;-2,5;3\n", point, "a.csv");
  expect_point("x;y;z\n1,5;-2,5;3\n", point, "a.csv");
  expect_point("1,5 -2,5 3\n", point);
  expect_point("1,5\t-2,5\t3,0\n", point);
  expect_point("1.5, -2.5, 3\n", point, "a.csv");
  expect_point("1.5,-2.5,3\n", point, "a.csv");
  const ReadModel late = model_of("1;2;3\n1,5;2,5;3\n", "a.csv");
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
  const ReadModel pts = model_of("1\n1 2 3\n4 5 6\n7 8 9\n", "a.pts");
  EXPECT_TRUE(warns(pts, "promises 1 points, the file holds 2 more"));
  const ReadModel ascii =
      model_of("ply\nformat ascii 1.0\nelement vertex 1\n" + kFloats + "1 2 3\n4 5 6\n\n7 8 9\n", "a.ply");
  EXPECT_TRUE(warns(ascii, "2 rows follow the last element"));
  const std::string binary =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\n" + kFloats + std::string(12, '\0');
  EXPECT_TRUE(warns(model_of(binary + "abcde", "a.ply"), "5 bytes follow the last element"));
  EXPECT_FALSE(warns(model_of(binary + "\n", "a.ply"), "follow the last element"));
}

TEST(Tables, FloatsFarFromTheOriginSayTheirPrecision) {
  const auto grid_at = [](float place) {
    std::string file = "ply\nformat binary_little_endian 1.0\nelement vertex 100\n" + kFloats;
    for (int i = 0; i < 100; ++i)
      for (const float v : {place + static_cast<float>(i % 10), static_cast<float>(i / 10), 0.0F})
        put(file, v, false);
    return file;
  };
  ReadOptions options;
  options.unit = Unit::kMillimetre;
  EXPECT_TRUE(warns(model_of(grid_at(4e6F), "a.ply", options), "precision of 0.25 mm"));
  EXPECT_FALSE(warns(model_of(grid_at(4e3F), "a.ply", options), "precision"));
}

}  // namespace
}  // namespace palpate::io
