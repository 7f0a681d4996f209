#include "baselines/reconstruct/reconstruct.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <limits>

#include <palpate/result.h>
#include "baselines/option_specs.h"
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/parallel.h"

namespace palpate::baselines {
namespace {

std::vector<OptionSpec> with_normals(std::vector<OptionSpec> own) {
  own.push_back(
      option::choice("normals", "planes",
                     "normals for methods that need them: planes of 8 neighbours, turned as cloud turns its "
                     "own; or CGAL's principal components or jets, turned along a spanning tree",
                     {"planes", "pca", "jet"}));
  own.push_back(option::integer("normal_neighbours", "18", "neighbours of a point for normals=pca and jet", 4,
                                200, {{"normals", {"pca", "jet"}}}));
  return own;
}

std::vector<Method> make_methods() {
  std::vector<Method> all;
  all.push_back(
      {"advancing-front",
       "triangles added one by one from the Delaunay triangulation",
       "Cohen-Steiner and Da 2004, CGAL",
       {option::number("front_radius_ratio", "5", "advancing front: bound on the ratio of radii", 1, 1e6),
        option::number("front_beta", "0.52", "advancing front: half angle of the candidate wedge, rad", 0.01,
                       1.57)}});
  all.push_back(
      {"poisson", "level set of a function whose gradient follows the normals",
       "Kazhdan, Bolitho and Hoppe 2006, Kazhdan and Hoppe 2013; PCL, or CGAL",
       with_normals(
           {option::choice("poisson_on", "octree",
                           "Poisson: solved on an octree (PCL), or on a Delaunay refinement and meshed by "
                           "another (CGAL)",
                           {"octree", "delaunay"}),
            option::number("poisson_cell", "1",
                           "Poisson on an octree: largest edge of its finest cells, spacings", 0.1, 1000,
                           {{"poisson_on", {"octree"}}}),
            option::number("poisson_angle", "20", "Poisson by Delaunay: smallest angle of a facet, degrees",
                           1, 30, {{"poisson_on", {"delaunay"}}}),
            option::number("poisson_radius", "3", "Poisson by Delaunay: largest radius of a facet, spacings",
                           0.1, 1000, {{"poisson_on", {"delaunay"}}}),
            option::number("poisson_distance", "0.2",
                           "Poisson by Delaunay: distance between facet and surface, spacings", 1e-3, 100,
                           {{"poisson_on", {"delaunay"}}}),
            option::number(
                "poisson_trim", "1.5",
                "Poisson: facets farther than so many spacings from every point are left out; 0: none", 0,
                1e6)})});
  all.push_back(
      {"scale-space",
       "points smoothed, connected where smooth, the triangles taken back to the points",
       "Digne et al. 2011, CGAL",
       {option::integer("scale_iterations", "4", "scale space: rounds of smoothing", 0, 100),
        option::choice("scale_smoother", "jet", "scale space: how a round smooths", {"jet", "pca"},
                       {{"scale_iterations", {"0"}, true}}),
        option::integer("scale_neighbours", "12", "scale space: neighbours of a point when smoothing", 6, 200,
                        {{"scale_iterations", {"0"}, true}}),
        option::choice("scale_mesher", "front", "scale space: what connects the smoothed points",
                       {"front", "alpha"})},
       2});
  all.push_back(
      {"alpha-shape",
       "facets of the Delaunay triangulation with an empty ball of the given radius",
       "Edelsbrunner and Mücke 1994, CGAL",
       {option::number("alpha_radius", "2.5",
                       "alpha shape: radius of the ball, spacings; 0: the smallest that leaves one solid", 0,
                       1e6)}});
  all.push_back({"power-crust",
                 "faces between the inner and outer balls of the medial axis, closed by construction",
                 "Amenta, Choi and Kolluri 2001 (the thesis's [31]), on CGAL's triangulations",
                 {},
                 2});
  all.push_back(
      {"ball-pivoting", "a ball rolled from edge to edge", "Bernardini et al. 1999, Open3D",
       with_normals(
           {option::number("ball_radius", "1.25", "ball pivoting: smallest ball, spacings", 0.1, 100),
            option::integer("ball_sizes", "3", "ball pivoting: how many balls, each twice the one before", 1,
                            6)})});
#ifndef PALPATE_WITH_OPEN3D
  all.back().not_built = "install the package libopen3d-dev and configure with -DPALPATE_WITH_OPEN3D=ON";
#endif
  all.push_back(
      {"greedy-projection", "neighbours projected on the tangent plane and connected greedily",
       "Gopi and Krishnan 2002, Marton et al. 2009, PCL",
       with_normals(
           {option::number("greedy_mu", "2.5",
                           "greedy projection: reach, in distances to the nearest neighbour", 1, 100),
            option::number("greedy_radius", "4", "greedy projection: largest edge, spacings", 0.5, 1000)})});
  all.push_back(
      {"marching-cubes", "zero set of the distance to the nearest point's tangent plane, by cubes",
       "Hoppe et al. 1992, Lorensen and Cline 1987, PCL",
       with_normals(
           {option::number("cubes_cell", "1", "marching cubes: edge of a cube, spacings", 0.05, 1000),
            option::number("cubes_reach", "3",
                           "marching cubes: no surface farther from every point, spacings", 1, 1000)})});
  all.push_back(
      {"organised",
       "neighbours in the scanner's raster connected",
       "Holz and Behnke 2012, PCL",
       {option::number("organised_longest", "0",
                       "organised: longer edges are left out, spacings; 0: all are kept", 0, 1e6)}});
  all.back().raster_only = true;
  all.back().version = 2;  // organised_longest skips edges
  all.push_back({"stars",
                 "triangles that the points agree on: the surface that cloud feels",
                 "ours, see docs/explanation/the-surface.md",
                 {}});
  all.back().version = 2;  // uses a raster if present
  return all;
}

}  // namespace

const std::vector<Method>& methods() {
  static const std::vector<Method> all = make_methods();
  return all;
}

Result<const Method*> find_method(std::string_view name) {
  std::string names;
  for (const Method& method : methods()) {
    if (method.name == name) {
      if (method.not_built.empty()) return &method;
      return Error{fmt::format("this build does not have the reconstruction '{}'", name), method.not_built};
    }
    names += (names.empty() ? "" : ", ") + method.name;
  }
  return Error{fmt::format("there is no reconstruction '{}'", name), "take one of " + names};
}

std::vector<OptionSpec> all_method_options(const std::string& method_key) {
  std::vector<OptionSpec> all;
  for (const Method& method : methods())
    for (const OptionSpec& spec : method.options) {
      auto at = std::find_if(all.begin(), all.end(), [&](const OptionSpec& s) { return s.key == spec.key; });
      if (at == all.end()) {
        at = all.insert(all.end(), spec);
        at->only_with.insert(at->only_with.begin(), {method_key});
      }
      at->only_with.front().values.push_back(method.name);
    }
  return all;
}

Options own_options(const Method& method, const Options& options) {
  Options own;
  for (const OptionSpec& spec : method.options)
    if (options.has(spec.key)) own.set(spec.key, options.text(spec.key));
  return own;
}

namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMagic = 0x3148534D50'4C5050;  // "PPLPMSH1"
constexpr const char* kEnding = ".mesh";

enum class Kind : std::uint8_t { kMesh = 1, kGaveUp };

std::uint64_t hash_of(std::string_view bytes) {
  Hash64 hash;
  hash.bytes(std::as_bytes(std::span(bytes)));
  return hash.value();
}

/// The time limit in comparable form: none is infinite.
double time_of(const Limits& limits) {
  return limits.time_s > 0.0 ? limits.time_s : std::numeric_limits<double>::infinity();
}

/// The bytes between magic and checksum; nothing if these are wrong.
std::optional<std::string_view> checked_body(std::string_view bytes) {
  constexpr std::size_t kWord = sizeof(std::uint64_t);
  if (bytes.size() < 2 * kWord) return std::nullopt;
  const std::string_view before = bytes.substr(0, bytes.size() - kWord);
  InputArchive ends(bytes.substr(bytes.size() - kWord)), starts(before);
  if (ends.value<std::uint64_t>() != hash_of(before) || starts.value<std::uint64_t>() != kMagic)
    return std::nullopt;
  return before.substr(kWord);
}

}  // namespace

std::string cache_key(const Method& method, const cloud::Cloud& cloud, const Options& options) {
  OutputArchive bytes;
  write(bytes, cloud);
  std::string key = fmt::format("{} {} ({}) points={} hash={:016x}", method.name, method.version,
                                PALPATE_MESH_LIBRARIES, cloud.size(), hash_of(bytes.bytes()));
  for (const auto& [name, value] : options.all()) key += fmt::format(" {}={}", name, value);
  return key;
}

std::optional<MeshCache> MeshCache::standard() {
  if (const char* given = std::getenv("PALPATE_MESH_CACHE"); given != nullptr && *given != '\0') {
    if (std::string_view(given) == "off") return std::nullopt;
    return MeshCache(given);
  }
  const fs::path folder = cache_folder();
  if (folder.empty()) return std::nullopt;
  return MeshCache(folder / "meshes");
}

fs::path MeshCache::file_of(const std::string& key) const {
  return folder_ / fmt::format("{}-{:016x}{}", key.substr(0, key.find(' ')), hash_of(key), kEnding);
}

std::optional<CachedAnswer> MeshCache::find(const std::string& key, const Limits& limits) const {
  const fs::path path = file_of(key);
  std::error_code code;
  const Result<std::string> bytes = read_file(path.string(), kMemoryLimitBytes);
  if (!bytes) return std::nullopt;
  const std::optional<std::string_view> body = checked_body(*bytes);
  InputArchive reader(body.value_or(std::string_view()));
  if (reader.value<std::string>() != key || !reader.good()) {
    fs::remove(path, code);
    return std::nullopt;
  }
  if (reader.value<Kind>() == Kind::kGaveUp) {
    const auto time_s = reader.value<double>();
    const auto memory = reader.value<std::uint64_t>();
    const auto made_on = reader.value<std::string>();
    Error error = read_error(reader);
    if (!reader.at_end() || time_of(limits) > time_s || memory_limit(limits) > memory) return std::nullopt;
    error.what += fmt::format(" [recorded {}]", made_on);
    return error;
  }
  Result<Reconstruction> kept = read_reconstruction(reader);
  if (!kept || !reader.at_end()) {
    fs::remove(path, code);
    return std::nullopt;
  }
  kept->recorded = true;
  fs::last_write_time(path, fs::file_time_type::clock::now(), code);  // marks the entry as recently used
  return kept;
}

Status MeshCache::keep(const std::string& key, const Result<Reconstruction>& answer, const Limits& limits) {
  if (!answer && !answer.error().gave_up) return Done{};
  OutputArchive body;
  body(kMagic);
  body(key);
  if (answer) {
    body(Kind::kMesh);
    write(body, *answer);
  } else {
    body(Kind::kGaveUp);
    body(time_of(limits));
    body(static_cast<std::uint64_t>(memory_limit(limits)));
    body(now_text());
    write(body, answer.error());
  }
  body(hash_of(body.bytes()));
  std::error_code code;
  fs::create_directories(folder_, code);
  PALPATE_TRY(write_file(file_of(key).string(), body.bytes()));
  make_room();
  return Done{};
}

void MeshCache::make_room() const {
  struct Entry {
    fs::file_time_type read;
    std::uint64_t bytes;
    fs::path path;
  };
  // Remains of a killed writer.
  constexpr auto kStale = std::chrono::hours(1);
  std::vector<Entry> entries;
  std::uint64_t sum = 0;
  std::error_code code;
  for (const fs::directory_entry& file : fs::directory_iterator(folder_, code)) {
    const fs::file_time_type read = file.last_write_time(code);
    const std::uint64_t bytes = file.file_size(code);
    if (file.path().extension() != kEnding) {
      if (fs::file_time_type::clock::now() - read > kStale) fs::remove(file.path(), code);
      continue;
    }
    entries.push_back({read, bytes, file.path()});
    sum += bytes;
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.read < b.read; });
  for (std::size_t i = 0; i + 1 < entries.size() && sum > most_bytes_; ++i) {
    fs::remove(entries[i].path, code);
    sum -= entries[i].bytes;
  }
}

Result<Reconstruction> reconstruct(const ReconstructRequest& request, const cloud::Cloud& cloud,
                                   Progress& progress) {
  PALPATE_ASSIGN(const Method* const method, find_method(request.method));
  PALPATE_ASSIGN(const Options options, validate(request.options, method->options, request.method));
  std::string key;
  if (request.cache != nullptr) {
    progress.report(request.method + ": looking into the cache", -1.0);
    key = cache_key(*method, cloud, options);
    if (std::optional<CachedAnswer> kept = request.cache->find(key, request.limits)) return *std::move(kept);
  }
  const int threads = request.threads > 0 ? request.threads : available_threads();
  Result<Reconstruction> made = run_limited(*method, cloud, options, request.limits, threads, progress);
  if (request.cache != nullptr)
    if (const Status kept = request.cache->keep(key, made, request.limits); !kept && made)
      made->made.notes.push_back("not kept in the cache: " + kept.error().message());
  return made;
}

}  // namespace palpate::baselines
