// Which file may include which, found from the include lines.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <regex>
#include <set>
#include <string_view>

#include "tests/house/source_tree.h"

namespace palpate::house {
namespace {

using Folders = std::vector<std::string>;

// Includes allowed between top-level folders.
const std::map<std::string, std::set<std::string>> kTopLevel = {
    {"toolkit", {"toolkit"}},
    {"baselines", {"toolkit", "baselines"}},
    {"device", {"toolkit", "device"}},
    {"experiments", {"toolkit", "baselines", "device", "experiments"}},
    {"tests", {"toolkit", "baselines", "device", "experiments", "tests"}},
};

// Includes allowed between rooms of experiments: pages are made from a study's files, without anything that
// runs or measures; nothing includes the command line.
const std::map<std::string, std::set<std::string>> kInExperiments = {
    {"study", {"study"}},
    {"streams", {"streams"}},
    {"run", {"study", "streams", "run"}},
    {"data", {"run", "data"}},
    {"report", {"study", "report"}},
    {"session", {"study", "run", "data", "report", "session"}},
    {"driver", {"study", "run", "data", "report", "session", "driver"}},
    {"behaviours", {"study", "run", "report", "session", "driver", "behaviours"}},
    {"bench", {"study", "run", "report", "session", "driver", "bench"}},
    {"stress", {"study", "run", "report", "session", "driver", "stress"}},
    {"tables", {"study", "run", "data", "report", "session", "driver", "behaviours", "tables"}},
    {"stability", {"study", "run", "data", "report", "session", "driver", "stability"}},
    {"trade", {"study", "run", "data", "report", "session", "driver", "trade"}},
    {"hunt", {"study", "run", "report", "session", "driver", "hunt"}},
    {"formats", {"formats"}},
    {"ablate", {"study", "run", "data", "report", "session", "driver", "ablate"}},
    // A session may open a window; a window knows no session.
    {"window", {"report", "window"}},
    {"live", {"study", "run", "data", "report", "session", "driver", "window", "streams", "live"}},
    {"bridge", {"study", "run", "session", "live", "bridge"}},
    {"goals", {"study", "run", "data", "report", "session", "driver", "stability", "goals"}},
    {"psychophysics", {"study", "run", "data", "report", "session", "driver", "live", "psychophysics"}},
    {"python", {"study", "run", "data", "session", "live", "python"}},
    {"command", {"study", "run",    "data",   "report",        "session", "driver", "behaviours",
                 "bench", "stress", "tables", "stability",     "trade",   "hunt",   "ablate",
                 "live",  "bridge", "goals",  "psychophysics", "streams", "command"}},
    {"benchmarks", {"window", "benchmarks"}},
};

// Room of each public header: whoever may include the room may include the header.
const std::map<std::string, std::string> kPublic = {
    {"palpate/accuracy.h", "toolkit/metrics"},
    {"palpate/analytic_surface.h", "toolkit/geometry"},
    {"palpate/baselines.h", "baselines"},
    {"palpate/clock.h", "toolkit/core"},
    {"palpate/cloud.h", "toolkit/cloud"},
    {"palpate/control.h", "toolkit/control"},
    {"palpate/decision.h", "toolkit/render"},
    {"palpate/depth_stream.h", "toolkit/render"},
    {"palpate/geometry.h", "toolkit/geometry"},
    {"palpate/generate.h", "toolkit/cloud"},
    {"palpate/triple_buffer.h", "toolkit/core"},
    {"palpate/model_store.h", "toolkit/render"},
    {"palpate/motion.h", "toolkit/render"},
    {"palpate/options.h", "toolkit/core"},
    {"palpate/paths.h", "toolkit/trace"},
    {"palpate/progress.h", "toolkit/core"},
    {"palpate/read_model.h", "toolkit/io"},
    {"palpate/registry.h", "toolkit/render"},
    {"palpate/renderer.h", "toolkit/render"},
    {"palpate/renderer_plugin.h", "toolkit/render"},
    {"palpate/replay.h", "toolkit/trace"},
    {"palpate/result.h", "toolkit/core"},
    {"palpate/scene.h", "toolkit/scene"},
    {"palpate/surface.h", "toolkit/surface"},
    {"palpate/trace.h", "toolkit/trace"},
    {"palpate/vec.h", "toolkit/core"},
    {"palpate/device/contact_catch_up.h", "device/interface"},
    {"palpate/device/device.h", "device/interface"},
    {"palpate/device/drivers.h", "device/interface"},
    {"palpate/device/force_governor.h", "device/interface"},
    {"palpate/device/guard.h", "device/safety"},
    {"palpate/device/heartbeat.h", "device/safety"},
    {"palpate/device/link.h", "device/interface"},
    {"palpate/device/loop_histogram.h", "device/servo"},
    {"palpate/device/scheduling.h", "device/servo"},
    {"palpate/device/servo.h", "device/servo"},
    {"palpate/device/servo_loop.h", "device/servo"},
    {"palpate/device/servo_thread.h", "device/servo"},
    {"palpate/device/watchdog.h", "device/safety"},
};

// Order of modules in toolkit: each may include itself and earlier ones.
constexpr std::array kToolkitLine = {
    "core",      "geometry", "cloud",       "search",     "surface",     "local_delaunay",
    "render",    "points",   "deformation", "spline_sdf", "heightfield", "depth_surface",
    "renderers", "control",  "trace",       "paths",      "metrics",     "laz",
    "io",        "prepared", "pcd",         "voronoi",    "dem",         "stream",
    "scene",     "plan",
};

// The same for device.
constexpr std::array kDeviceLine = {"interface",  "safety", "servo",   "simulated", "record",
                                    "live",       "links",  "falcon",  "arms",      "haply",
                                    "spacemouse", "bridge", "plugins", "drivers"};

// Libraries that compile slowly, carry a licence or bring many dependencies, and where their headers may be:
// in sources, and in headers.
struct Heavy {
  std::string prefix;
  Folders sources;
  Folders headers;
};
const std::vector<Heavy> kHeavy = {
    {"CGAL/",
     {"toolkit/voronoi/", "baselines/", "tests/baselines/"},
     {"baselines/reconstruct/cgal_points.h"}},
    {"pcl/", {"toolkit/pcd/", "baselines/", "tests/toolkit/pcd/", "tests/baselines/"}, {}},
    {"OpenMesh/", {"baselines/", "tests/baselines/"}, {"baselines/mesh/"}},
    {"embree", {"baselines/", "tests/baselines/"}, {"baselines/proximity/"}},
    {"openvdb/", {"baselines/points/"}, {}},
    {"vtk", {}, {}},
    {"libusb", {"device/links/", "tests/device/"}, {}},
    {"hidapi", {"device/links/", "tests/device/"}, {}},
    {"libudev", {"device/links/", "tests/device/"}, {}},
    {"boost/beast/", {"device/links/", "tests/device/"}, {}},
    {"umockdev", {"tests/device/"}, {}},
    {"OpenNI.h", {"toolkit/stream/openni/"}, {}},
    {"GLFW/", {"experiments/window/", "tests/experiments/"}, {}},
    {"imgui", {"experiments/window/"}, {}},
    {"backends/imgui", {"experiments/window/"}, {}},
    {"SDL2/", {"experiments/window/"}, {}},
    {"epoxy/", {"experiments/window/", "tests/experiments/"}, {}},
    {"hdf5", {"experiments/live/", "tests/experiments/"}, {}},
    {"gdal", {"toolkit/dem/", "tests/toolkit/dem/"}, {}},
    {"cpl_", {"toolkit/dem/", "tests/toolkit/dem/"}, {}},
    {"ogr_", {"toolkit/dem/", "tests/toolkit/dem/"}, {}},
    {"CLI/", {"experiments/", "tests/experiments/"}, {"experiments/command/cli.h"}},
    {"toml++/",
     {"toolkit/scene/", "device/arms/", "experiments/", "tests/toolkit/scene/", "tests/experiments/"},
     {"toolkit/scene/toml_fields.h"}},
    {"pybind11/", {"experiments/python/"}, {"experiments/python/"}},
    {"nlohmann/",
     {"toolkit/metrics/", "toolkit/stream/", "device/haply/", "experiments/", "tests/device/",
      "tests/toolkit/metrics/", "tests/experiments/", "tests/json_schema.cpp"},
     {"experiments/driver/json_document.h", "tests/experiments/program.h"}},  // documents
    {"valijson/", {"tests/json_schema.cpp"}, {}},
    {"spdlog/", {"experiments/", "tests/experiments/"}, {}},
    {"pugixml", {"toolkit/io/"}, {}},
    {"nanoflann", {"toolkit/search/", "experiments/benchmarks/", "tests/"}, {}},
    // Parallelism goes through one wrapper (toolkit/core/parallel.h); otherwise ThreadSanitizer sees nothing.
    {"tbb/", {"toolkit/core/"}, {}},
    {"oneapi/", {"toolkit/core/"}, {}},
    {"execution", {}, {}},
};

std::string first_folder(const std::string& path) {
  const std::size_t slash = path.find('/');
  return slash == std::string::npos ? std::string() : path.substr(0, slash);
}

std::string second_folder(const std::string& path) {
  const std::size_t slash = path.find('/');
  return slash == std::string::npos ? std::string() : first_folder(path.substr(slash + 1));
}

/// "palpate/vec.h" of "toolkit/include/palpate/vec.h"; empty if not a public header.
std::string public_name(const std::string& file) {
  static const std::string kRoot = "/include/";
  const std::size_t at = file.find(kRoot + "palpate/");
  return at == std::string::npos || !file.ends_with(".h") ? std::string() : file.substr(at + kRoot.size());
}

// A public header's path, as a file or an include, in its room; other paths unchanged.
std::string in_its_room(const std::string& path) {
  const std::string name = public_name(path);
  const auto found = kPublic.find(name.empty() ? path : name);
  return found == kPublic.end() ? path : found->second + path.substr(path.rfind('/'));
}

template <std::size_t N>
int place_in_line(const std::array<const char*, N>& line, const std::string& module) {
  const auto* at = std::find(line.begin(), line.end(), module);
  return at == line.end() ? -1 : static_cast<int>(at - line.begin());
}

bool starts_with_any(const std::string& file, const Folders& folders) {
  return std::any_of(folders.begin(), folders.end(),
                     [&](const std::string& f) { return file.starts_with(f); });
}

template <std::size_t N>
std::string forbidden_in_line(const std::array<const char*, N>& line, const std::string& top,
                              const std::string& from, const std::string& to) {
  const int from_place = place_in_line(line, from);
  const int to_place = place_in_line(line, to);
  if (from_place < 0) return top + "/" + from + " has no place in the line of modules";
  if (to_place < 0) return top + "/" + to + " has no place in the line of modules";
  if (to_place > from_place)
    return top + "/" + to + " comes after " + top + "/" + from + " in the line of modules";
  return {};
}

/// Path of an #include line ("palpate/vec.h", "CGAL/Kernel.h"); nothing for other lines.
std::optional<std::string> included_path(std::string_view line) {
  static const std::regex kInclude(R"(^\s*#\s*include\s*[<"]([^>"]+)[>"])");
  if (line.find("include") == std::string_view::npos) return std::nullopt;  // regular expressions are slow
  std::match_results<std::string_view::const_iterator> match;
  if (!std::regex_search(line.begin(), line.end(), match, kInclude)) return std::nullopt;
  return match[1].str();
}

/// Public headers as an application includes them, sorted.
std::vector<std::string> public_headers() {
  std::vector<std::string> names;
  for (const auto& [name, room] : kPublic) names.push_back(name);
  return names;
}

/// Why a line is not allowed in a public header, which includes only public ones, the standard library and
/// Eigen; empty if allowed.
std::string leak(std::string_view line) {
  const auto path = included_path(line);
  if (!path) return {};
  const bool quoted = line.find('"') < line.find('<');
  if (!quoted && (kPublic.count(*path) != 0 || path->starts_with("Eigen/") || *path == "sys/types.h" ||
                  path->find('/') == std::string::npos))
    return {};
  return *path + " is not there for who includes a public header";
}

/// Why a file (relative to the root) must not include a path; empty if allowed.
std::string forbidden(const std::string& written_file, const std::string& written_path) {
  const std::string file = in_its_room(written_file);
  const std::string path = in_its_room(written_path);
  if (path.starts_with("palpate/")) return path + " is no public header";
  const std::string from = first_folder(file);
  const std::string to = first_folder(path);
  if (path.find("..") != std::string::npos) return "paths are written from the root of the repository";
  const auto rule = kTopLevel.find(from);
  if (rule == kTopLevel.end()) return "sources stand in toolkit, baselines, device, experiments or tests";
  if (kTopLevel.count(to) != 0) {
    if (rule->second.count(to) == 0) return from + " may not include " + to;
    if (from == "experiments" && to == "experiments") {
      const auto room = kInExperiments.find(second_folder(file));
      if (room == kInExperiments.end())
        return "experiments/" + second_folder(file) + " is no room that the arrows know";
      if (room->second.count(second_folder(path)) == 0)
        return room->first + " may not include experiments/" + second_folder(path);
    }
    const std::string inner_from = second_folder(file);
    const std::string inner_to = second_folder(path);
    if (from == "toolkit") return forbidden_in_line(kToolkitLine, from, inner_from, inner_to);
    if (from == "device" && to == "device") return forbidden_in_line(kDeviceLine, from, inner_from, inner_to);
    return {};
  }
  for (const Heavy& heavy : kHeavy) {
    if (!path.starts_with(heavy.prefix)) continue;
    if (!starts_with_any(file, heavy.sources)) return path + " may not be included in this folder";
    if (file.ends_with(".h") && !starts_with_any(file, heavy.headers))
      return path + " may be included in source files only";
  }
  return {};
}

// ---- the tree

TEST(IncludeEdges, TheTreeHasNoForbiddenOne) {
  std::size_t seen = 0;
  const std::string found =
      findings_by_line(is_source, [&](const std::string& file, const std::string& line) {
        const auto path = included_path(line);
        seen += path ? 1u : 0u;
        return path ? forbidden(file, *path) : std::string();
      });
  EXPECT_EQ(found, "");
  EXPECT_GT(seen, 50u) << "too few include lines: is this the source tree?";
}

/// Names that a pattern's group finds between two marks of a text.
std::vector<std::string> names_between(const std::string& text, const std::string& from,
                                       const std::string& to, const std::regex& name) {
  const std::size_t begin = text.find(from), end = text.find(to, begin);
  if (begin == std::string::npos || end == std::string::npos) return {};
  const std::string part = text.substr(begin, end - begin);
  std::vector<std::string> names;
  for (std::sregex_iterator it(part.begin(), part.end(), name), last; it != last; ++it)
    names.push_back((*it)[1]);
  return names;
}

TEST(IncludeEdges, ThePageDrawsTheSameLines) {
  const std::string page = text_of("docs/how-to/change-palpate.md");
  EXPECT_EQ(names_between(page, "core -> geometry", "```", std::regex("([a-z_]+)")),
            std::vector<std::string>(kToolkitLine.begin(), kToolkitLine.end()));
  EXPECT_EQ(names_between(page, "order: `interface`", ". In `experiments`", std::regex("`([a-z]+)`")),
            std::vector<std::string>(kDeviceLine.begin(), kDeviceLine.end()));
}

TEST(IncludeEdges, LinesAreRead) {
  EXPECT_EQ(included_path("#include \"toolkit/core/vec.h\""), "toolkit/core/vec.h");
  EXPECT_EQ(included_path("  #  include   <CGAL/Surface_mesh.h>  // why"), "CGAL/Surface_mesh.h");
  EXPECT_EQ(included_path("#include <palpate/vec.h>"), "palpate/vec.h");
  EXPECT_EQ(included_path("// #include \"toolkit/core/vec.h\""), std::nullopt);
  EXPECT_EQ(included_path("#define INCLUDE 1"), std::nullopt);
}

struct Edge {
  const char* file;
  const char* path;
};

TEST(IncludeEdges, ForbiddenOnesAreFound) {
  // Each rule once: between top-level folders, rooms of experiments, the lines of modules, names that the
  // lines do not know, libraries by folder and by kind of file, how paths are written, public headers.
  const Edge edges[] = {
      {"toolkit/render/a.cpp", "baselines/mesh/b.h"},
      {"baselines/mesh/a.cpp", "device/loop.h"},
      {"device/a.cpp", "experiments/b.h"},
      {"experiments/a.cpp", "tests/house/source_tree.h"},
      {"experiments/report/a.cpp", "experiments/run/run.h"},
      {"experiments/new_room/a.cpp", "experiments/study/study.h"},
      {"toolkit/core/a.h", "toolkit/geometry/aabb.h"},
      {"toolkit/new_folder/a.cpp", "toolkit/core/vec.h"},
      {"toolkit/core/a.cpp", "toolkit/new_folder/b.h"},
      {"device/interface/a.h", "device/servo/b.h"},
      {"device/new_folder/a.cpp", "device/interface/b.h"},
      {"toolkit/cloud/a.cpp", "CGAL/Surface_mesh.h"},
      {"toolkit/pcd/a.h", "pcl/io/pcd_io.h"},
      {"toolkit/cloud/a.cpp", "execution"},
      {"toolkit/cloud/a.cpp", "../core/vec.h"},
      {"elsewhere/a.cpp", "toolkit/core/vec.h"},
      {"toolkit/core/a.cpp", "palpate/registry.h"},
      {"toolkit/include/palpate/vec.h", "palpate/scene.h"},
      {"experiments/study/a.cpp", "palpate/no_such.h"},
  };
  for (const Edge& edge : edges)
    EXPECT_NE(forbidden(edge.file, edge.path), "") << edge.file << " -> " << edge.path;
}

TEST(IncludeEdges, AllowedOnesPass) {
  const Edge edges[] = {
      {"toolkit/geometry/a.h", "toolkit/core/vec.h"},
      {"toolkit/core/a.cpp", "toolkit/core/vec.h"},
      {"toolkit/pcd/a.cpp", "pcl/io/pcd_io.h"},
      {"baselines/mesh/a.cpp", "toolkit/render/renderer.h"},
      {"experiments/a.cpp", "baselines/mesh/b.h"},
      {"experiments/report/a.cpp", "experiments/study/study.h"},
      {"device/live/a.cpp", "device/record/b.h"},
      {"experiments/a.cpp", "nlohmann/json.hpp"},
      {"tests/toolkit/renderers/a.cpp", "experiments/report.h"},
      {"toolkit/core/a.h", "vector"},
      {"toolkit/core/a.h", "Eigen/Core"},
      {"toolkit/core/a.cpp", "palpate/vec.h"},
      {"device/include/palpate/device/servo.h", "palpate/renderer.h"},
  };
  for (const Edge& edge : edges)
    EXPECT_EQ(forbidden(edge.file, edge.path), "") << edge.file << " -> " << edge.path;
}

/// Why a room of toolkit must not open the namespace of a line; empty if it may. A namespace has its folder's
/// name; `core` and `renderers` are exceptions.
std::string foreign_namespace(const std::string& file, const std::string& line) {
  static const std::string kOpens = "namespace palpate";
  if (!line.starts_with(kOpens) || !file.starts_with("toolkit/") || !public_name(file).empty()) return {};
  const std::string room = second_folder(file);
  if (room.empty() || room == "core") return {};
  const std::string wanted = kOpens + "::" + (room == "renderers" ? "render" : room);
  if (line.starts_with(wanted + " ") || line.starts_with(wanted + "::")) return {};
  return "a file of " + room + " opens " + line;
}

TEST(Namespaces, HaveTheNamesOfTheirFolders) {
  EXPECT_EQ(findings_by_line(is_source, foreign_namespace), "");
}

TEST(Namespaces, OthersAreFound) {
  EXPECT_NE(foreign_namespace("toolkit/spline_sdf/a.h", "namespace palpate::render {"), "");
  EXPECT_NE(foreign_namespace("toolkit/points/a.cpp", "namespace palpate::pointsets {"), "");
  EXPECT_NE(foreign_namespace("toolkit/points/a.cpp", "namespace palpate {"), "");
  EXPECT_EQ(foreign_namespace("toolkit/points/a.cpp", "namespace palpate::points {"), "");
  EXPECT_EQ(foreign_namespace("toolkit/points/a.cpp", "namespace palpate::points::detail {"), "");
  EXPECT_EQ(foreign_namespace("toolkit/renderers/a.cpp", "namespace palpate::render {"), "");
  EXPECT_EQ(foreign_namespace("toolkit/core/a.cpp", "namespace palpate::option {"), "");
  EXPECT_EQ(foreign_namespace("toolkit/include/palpate/registry.h", "namespace palpate::voronoi {"), "");
  EXPECT_EQ(foreign_namespace("experiments/run/a.cpp", "namespace palpate::experiments {"), "");
}

TEST(PublicHeaders, IncludePublicOnesTheStandardLibraryAndEigenOnly) {
  const auto is_public = [](const std::string& file) { return !public_name(file).empty(); };
  std::vector<std::string> seen;
  for (const std::string& file : project_files())
    if (is_public(file)) seen.push_back(public_name(file));
  EXPECT_EQ(
      findings_by_line(is_public, [](const std::string&, const std::string& line) { return leak(line); }),
      "");
  std::sort(seen.begin(), seen.end());
  EXPECT_EQ(seen, public_headers()) << "the list above, each in its room";
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

}  // namespace
}  // namespace palpate::house
