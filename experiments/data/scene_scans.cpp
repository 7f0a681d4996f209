#include "experiments/data/scene_scans.h"

#include <fmt/format.h>

#include "experiments/data/fetch.h"
#include "experiments/data/locate.h"

namespace palpate::experiments {
namespace {

Result<std::filesystem::path> file_of(const std::string& name, bool fetch, Progress& progress) {
  const Scan* scan = find_scan(name);
  if (scan == nullptr) {
    std::vector<std::string> names;
    for (const Scan& known : known_scans()) names.push_back(known.name);
    const std::string near = scene::nearest_name(name, names);
    return Error{fmt::format("no scan is called '{}'", name),
                 near.empty() ? "`palpate fetch` lists them" : fmt::format("did you mean '{}'?", near),
                 {},
                 0};
  }
  if (std::optional<std::filesystem::path> here = locate_scan(*scan)) return *here;
  if (!fetch)
    return Error{fmt::format("the scan '{}' is not here", name),
                 fmt::format("`palpate fetch {}` brings it", name),
                 {},
                 0};
  FetchOptions options;
  options.cache = cache_folder();
  return fetch_scan(*scan, options, progress);
}

}  // namespace

Status find_scans(scene::SceneFile& scene, bool fetch, Progress& progress) {
  for (scene::SceneModel& model : scene.models) {
    if (model.scan.empty()) continue;
    const Result<std::filesystem::path> file = file_of(model.scan, fetch, progress);
    if (!file)
      return file.error().file.empty() ? Error(file.error()).in_file(scene.path, model.line) : file.error();
    model.cloud = file->string();
    if (model.unit) continue;
    const Result<io::Unit> unit = io::parse_unit(find_scan(model.scan)->unit);
    if (!unit) return unit.error();
    model.unit = *unit;
  }
  return Done{};
}

Result<scene::SceneFile> open_scene(const std::string& argument, Progress& progress) {
  Result<scene::SceneFile> scene = scene::open_scene(argument);
  if (!scene) return scene;
  if (const Status found = find_scans(*scene, false, progress); !found) return found.error();
  return scene;
}

}  // namespace palpate::experiments
