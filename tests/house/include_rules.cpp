#include "tests/house/include_rules.h"

#include <algorithm>
#include <array>
#include <initializer_list>
#include <map>
#include <regex>
#include <set>
#include <vector>

namespace palpate::house {
namespace {

using Folders = std::vector<std::string>;

// What each top-level folder may include of the others.
const std::map<std::string, std::set<std::string>> kTopLevel = {
    {"toolkit", {"toolkit"}},
    {"baselines", {"toolkit", "baselines"}},
    {"device", {"toolkit", "device"}},
    {"experiments", {"toolkit", "baselines", "device", "experiments"}},
    {"tests", {"toolkit", "baselines", "device", "experiments", "tests"}},
};

// What each room of experiments may include of the others: a page is made of the files of a study, and
// nothing that runs or measures is at hand where it is drawn; nobody needs the command line.
const std::map<std::string, std::set<std::string>> kInExperiments = {
    {"study", {"study"}},
    {"run", {"study", "run"}},
    {"data", {"run", "data"}},
    {"report", {"study", "report"}},
    {"session", {"study", "run", "data", "report", "session"}},
    {"behaviours", {"study", "run", "report", "session", "behaviours"}},
    {"stress", {"study", "run", "report", "session", "stress"}},
    {"tables", {"study", "run", "data", "report", "session", "behaviours", "tables"}},
    {"stability", {"study", "run", "data", "report", "session", "stability"}},
    {"trade", {"study", "run", "data", "report", "session", "trade"}},
    {"hunt", {"study", "run", "session", "hunt"}},
    {"formats", {"formats"}},
    {"ablate", {"study", "run", "data", "report", "session", "ablate"}},
    // A window knows no session, a session may open a window.
    {"window", {"report", "window"}},
    {"live", {"study", "run", "data", "report", "session", "window", "live"}},
    {"bridge", {"study", "run", "session", "live", "bridge"}},
    {"goals", {"study", "run", "data", "report", "session", "stability", "goals"}},
    {"psychophysics", {"study", "run", "data", "report", "session", "live", "psychophysics"}},
    {"command",
     {"study", "run", "data", "report", "session", "behaviours", "stress", "tables", "stability", "trade",
      "hunt", "ablate", "live", "bridge", "goals", "psychophysics", "command"}},
    {"benchmarks", {"window", "benchmarks"}},
};

// The line of modules inside toolkit: each sees itself and those before it.
constexpr std::array kToolkitLine = {
    "core",   "geometry",    "cloud",   "partition",   "neighbourhood", "surface", "stars", "render",
    "points", "deformation", "smooth",  "heightfield", "renderers",     "control", "trace", "metrics",
    "io",     "pcd",         "voronoi", "dem",         "scene",         "plan",
};

// The same inside device.
constexpr std::array kDeviceLine = {"interface",  "safety", "servo",   "simulated", "record",
                                    "live",       "links",  "falcon",  "arms",      "haply",
                                    "spacemouse", "bridge", "plugins", "drivers"};

// Libraries that are slow to compile, carry a licence or bring half a distribution: where their headers may
// stand in a source file, and where in a header as well.
struct Heavy {
  std::string prefix;
  Folders sources;
  Folders headers;
};
const std::vector<Heavy> kHeavy = {
    {"CGAL/",
     {"toolkit/voronoi/", "baselines/", "tests/baselines/", "experiments/benchmarks/"},
     {"baselines/reconstruct/cgal_points.h", "baselines/reconstruct/cgal_threads.h"}},
    {"pcl/",
     {"toolkit/pcd/", "baselines/", "tests/toolkit/pcd/", "tests/baselines/", "experiments/benchmarks/"},
     {}},
    {"OpenMesh/", {"baselines/", "tests/baselines/"}, {"baselines/mesh/"}},
    {"embree", {"baselines/", "tests/baselines/", "experiments/benchmarks/"}, {"baselines/proximity/"}},
    {"openvdb/", {"baselines/points/"}, {}},
    {"vtk", {}, {}},
    {"libusb", {"device/links/", "tests/device/"}, {}},
    {"hidapi", {"device/links/", "tests/device/"}, {}},
    {"libudev", {"device/links/", "tests/device/"}, {}},
    {"libwebsockets", {"device/links/", "tests/device/"}, {}},
    {"umockdev", {"tests/device/"}, {}},
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
    {"nlohmann/",
     {"toolkit/metrics/", "device/haply/", "experiments/", "tests/device/", "tests/toolkit/metrics/",
      "tests/experiments/", "tests/json_schema.cpp"},
     {}},
    {"valijson/", {"tests/json_schema.cpp"}, {}},
    {"spdlog/", {"experiments/", "tests/experiments/"}, {}},
    {"nanoflann", {"toolkit/neighbourhood/", "experiments/benchmarks/", "tests/"}, {}},
    // Parallelism goes through one wrapper (toolkit/core/parallel.h), or ThreadSanitizer sees nothing.
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

}  // namespace

std::optional<std::string> included_path(std::string_view line) {
  static const std::regex kInclude(R"(^\s*#\s*include\s*[<"]([^>"]+)[>"])");
  std::match_results<std::string_view::const_iterator> match;
  if (!std::regex_search(line.begin(), line.end(), match, kInclude)) return std::nullopt;
  std::string path = match[1].str();
  // An installed header is the same header.
  static const std::string kInstalled = "palpate/";
  if (path.starts_with(kInstalled)) path = path.substr(kInstalled.size());
  return path;
}

std::string forbidden(const std::string& file, const std::string& path) {
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

}  // namespace palpate::house
