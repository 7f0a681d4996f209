// Locates scans named in scenes, which the toolkit cannot.
#pragma once

#include <string>
#include <vector>

#include <palpate/progress.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include <palpate/scene.h>
#include "experiments/data/fetch.h"

namespace palpate::experiments {

[[nodiscard]] Error no_such_scan(const std::string& name);

/// Sets file and unit of every model that names a scan. `fetch`: missing or damaged scans are fetched; null:
/// they are an Error with the remedy. Repeated fetches are reported in `notes`.
[[nodiscard]] Status find_scans(scene::SceneFile& scene, const FetchOptions* fetch, Progress& progress,
                                std::vector<std::string>& notes);

/// Opens a command's SCENE argument with its scans found and its [renderer] checked, used or not. A scan's
/// name is valid too; a file of the same name has priority.
[[nodiscard]] Result<scene::SceneFile> open_scene(const std::string& argument,
                                                  const render::Registry& registry, Progress& progress);

}  // namespace palpate::experiments
