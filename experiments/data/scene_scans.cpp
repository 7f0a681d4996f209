#include "experiments/data/scene_scans.h"

#include <fmt/format.h>

#include <palpate/result.h>
#include "experiments/data/locate.h"
#include "experiments/run/arguments.h"
#include "toolkit/core/message_text.h"

namespace palpate::experiments {
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
               fmt::format("`palpate fetch {}` brings it", name),
               {},
               0};
}

}  // namespace

Error no_such_scan(const std::string& name) {
  return Error{"no scan is called " + shown(name),
               did_you_mean(name, scan_names(), "`palpate list scans` lists them"),
               {},
               0};
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
