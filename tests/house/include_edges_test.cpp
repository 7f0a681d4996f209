// Includes between folders go one way, found from the include lines.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/house/include_rules.h"
#include "tests/house/source_tree.h"

namespace palpate::house {
namespace {

TEST(IncludeEdges, TheTreeHasNoForbiddenOne) {
  std::size_t seen = 0;
  const std::string found = findings_over(is_source, [&](const std::string& file, const auto& lines) {
    std::string bad;
    for (std::size_t i = 0; i < lines.size(); ++i) {
      const auto path = included_path(lines[i]);
      if (!path) continue;
      ++seen;
      const std::string why = forbidden(file, *path);
      if (!why.empty()) bad += file + ":" + std::to_string(i + 1) + ": " + why + "\n";
    }
    return bad;
  });
  EXPECT_EQ(found, "");
  EXPECT_GT(seen, 50u) << "too few include lines: is this the source tree?";
}

TEST(IncludeEdges, LinesAreRead) {
  EXPECT_EQ(included_path("#include \"toolkit/core/vec.h\""), "toolkit/core/vec.h");
  EXPECT_EQ(included_path("  #  include   <CGAL/Surface_mesh.h>  // why"), "CGAL/Surface_mesh.h");
  EXPECT_EQ(included_path("#include <palpate/vec.h>"), "palpate/vec.h");
  EXPECT_EQ(included_path("// #include \"toolkit/core/vec.h\""), std::nullopt);
  EXPECT_EQ(included_path("#define INCLUDE 1"), std::nullopt);
}

// The code below "// First:" at a file's head, indented as in a function.
std::string first_example(const std::vector<std::string>& lines) {
  static const std::string kMark = "//   ";
  std::string code;
  bool inside = false;
  for (const std::string& line : lines) {
    if (inside && line != "//" && !line.starts_with(kMark)) break;
    if (inside) code += line == "//" ? "\n" : "  " + line.substr(kMark.size()) + "\n";
    if (line == "// First:") inside = true;
  }
  return code;
}

struct Edge {
  const char* file;
  const char* path;
};

TEST(IncludeEdges, ForbiddenOnesAreFound) {
  const Edge edges[] = {
      {"toolkit/render/a.cpp", "baselines/mesh/b.h"},
      {"toolkit/render/a.cpp", "device/loop.h"},
      {"toolkit/io/a.cpp", "experiments/report.h"},
      {"baselines/mesh/a.cpp", "device/loop.h"},
      {"device/a.cpp", "baselines/mesh/b.h"},
      {"device/a.cpp", "experiments/b.h"},
      {"experiments/a.cpp", "tests/house/source_tree.h"},
      {"experiments/report/a.cpp", "experiments/run/run.h"},
      {"experiments/report/a.h", "experiments/session/session.h"},
      {"experiments/study/a.cpp", "experiments/run/stage.h"},
      {"experiments/study/a.cpp", "experiments/report/page.h"},
      {"experiments/run/a.cpp", "experiments/report/page.h"},
      {"experiments/tables/a.cpp", "experiments/command/subcommand.h"},
      {"experiments/behaviours/a.cpp", "experiments/command/subcommand.h"},
      {"experiments/behaviours/a.cpp", "experiments/tables/manifest.h"},
      {"experiments/session/a.h", "experiments/behaviours/matrix.h"},
      {"experiments/report/a.cpp", "experiments/tables/manifest.h"},
      {"experiments/new_room/a.cpp", "experiments/study/study.h"},
      {"toolkit/core/a.cpp", "valijson/schema.hpp"},
      {"toolkit/core/a.h", "toolkit/geometry/aabb.h"},
      {"toolkit/cloud/a.cpp", "toolkit/render/renderer.h"},
      {"toolkit/render/a.cpp", "toolkit/trace/trace.h"},
      {"toolkit/io/a.cpp", "toolkit/pcd/pcd.h"},
      {"toolkit/new_folder/a.cpp", "toolkit/core/vec.h"},
      {"toolkit/core/a.cpp", "toolkit/new_folder/b.h"},
      {"toolkit/cloud/a.cpp", "CGAL/Surface_mesh.h"},
      {"toolkit/io/a.cpp", "pcl/io/pcd_io.h"},
      {"toolkit/pcd/a.h", "pcl/io/pcd_io.h"},
      {"toolkit/geometry/a.h", "OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh"},
      {"toolkit/render/a.cpp", "embree3/rtcore.h"},
      {"device/a.cpp", "embree4/rtcore.h"},
      {"experiments/a.h", "nlohmann/json.hpp"},
      {"toolkit/metrics/a.h", "nlohmann/json.hpp"},
      {"toolkit/trace/a.cpp", "nlohmann/json.hpp"},
      {"toolkit/search/a.cpp", "tbb/parallel_for.h"},
      {"toolkit/search/a.cpp", "oneapi/tbb.h"},
      {"toolkit/cloud/a.cpp", "execution"},
      {"toolkit/cloud/a.cpp", "../core/vec.h"},
      {"device/interface/a.h", "device/servo/b.h"},
      {"device/record/a.cpp", "device/live/b.h"},
      {"device/new_folder/a.cpp", "device/interface/b.h"},
      {"elsewhere/a.cpp", "toolkit/core/vec.h"},
      {"toolkit/core/a.cpp", "palpate/registry.h"},
      {"toolkit/include/palpate/vec.h", "palpate/scene.h"},
      {"baselines/a.cpp", "palpate/device/servo.h"},
      {"device/interface/a.cpp", "palpate/device/servo.h"},
      {"experiments/study/a.cpp", "palpate/no_such.h"},
  };
  for (const Edge& edge : edges)
    EXPECT_NE(forbidden(edge.file, edge.path), "") << edge.file << " -> " << edge.path;
}

TEST(IncludeEdges, AllowedOnesPass) {
  const Edge edges[] = {
      {"toolkit/geometry/a.h", "toolkit/core/vec.h"},
      {"toolkit/core/a.cpp", "toolkit/core/vec.h"},
      {"toolkit/plan/a.cpp", "toolkit/scene/b.h"},
      {"toolkit/pcd/a.cpp", "pcl/io/pcd_io.h"},
      {"toolkit/core/parallel.cpp", "tbb/parallel_for.h"},
      {"baselines/mesh/a.cpp", "CGAL/Surface_mesh.h"},
      {"baselines/mesh/a.cpp", "toolkit/render/renderer.h"},
      {"device/a.cpp", "toolkit/render/renderer.h"},
      {"experiments/a.cpp", "baselines/mesh/b.h"},
      {"experiments/report/a.cpp", "experiments/study/study.h"},
      {"experiments/run/a.cpp", "experiments/study/study.h"},
      {"experiments/command/a.cpp", "experiments/report/page.h"},
      {"experiments/tables/a.cpp", "experiments/behaviours/matrix.h"},
      {"experiments/tables/a.cpp", "experiments/session/session.h"},
      {"device/live/a.cpp", "device/record/b.h"},
      {"experiments/a.cpp", "device/loop.h"},
      {"experiments/a.cpp", "nlohmann/json.hpp"},
      {"tests/toolkit/renderers/a.cpp", "experiments/report.h"},
      {"toolkit/core/a.h", "vector"},
      {"toolkit/core/a.h", "Eigen/Core"},
      {"toolkit/core/a.cpp", "palpate/vec.h"},
      {"experiments/study/a.cpp", "palpate/scene.h"},
      {"device/include/palpate/device/servo.h", "palpate/renderer.h"},
  };
  for (const Edge& edge : edges)
    EXPECT_EQ(forbidden(edge.file, edge.path), "") << edge.file << " -> " << edge.path;
}

TEST(PublicHeaders, IncludePublicOnesTheStandardLibraryAndEigenOnly) {
  const auto is_public = [](const std::string& file) { return !public_name(file).empty(); };
  std::vector<std::string> seen;
  const std::string found = findings_over(is_public, [&](const std::string& file, const auto& lines) {
    seen.push_back(public_name(file));
    std::string bad;
    for (std::size_t i = 0; i < lines.size(); ++i) {
      const std::string why = leak(lines[i]);
      if (!why.empty()) bad += file + ":" + std::to_string(i + 1) + ": " + why + "\n";
    }
    return bad;
  });
  EXPECT_EQ(found, "");
  std::sort(seen.begin(), seen.end());
  EXPECT_EQ(seen, public_headers()) << "the list of include_rules.cpp, each in its room";
}

TEST(PublicHeaders, LeaksAreFound) {
  EXPECT_NE(leak("#include \"toolkit/core/message_text.h\""), "");
  EXPECT_NE(leak("#include <toolkit/core/message_text.h>"), "");
  EXPECT_NE(leak("#include <palpate/no_such.h>"), "");
  EXPECT_NE(leak("#include <fmt/format.h>"), "");
  EXPECT_NE(leak("#include \"palpate/vec.h\""), "") << "in angle brackets, as an application does";
  EXPECT_EQ(leak("#include <palpate/vec.h>"), "");
  EXPECT_EQ(leak("#include <Eigen/Core>"), "");
  EXPECT_EQ(leak("#include <vector>"), "");
  EXPECT_EQ(leak("// vectors"), "");
}

// A header's first example is compiled in public_examples.cpp, with no other header of ours.
TEST(PublicHeaders, ShowAnExampleFirst) {
  const std::string compiled = text_of("tests/house/public_examples.cpp");
  const auto is_public = [](const std::string& file) { return !public_name(file).empty(); };
  EXPECT_EQ(findings_over(is_public,
                          [&](const std::string& file, const auto& lines) {
                            const std::string code = first_example(lines);
                            return !code.empty() && compiled.find(code) != std::string::npos
                                       ? std::string()
                                       : file + " shows no example of public_examples.cpp\n";
                          }),
            "");
}

}  // namespace
}  // namespace palpate::house
