// Scenes that name a scan: where the scan's file lies is known here, not in the toolkit.
#pragma once

#include <string>
#include <vector>

#include "experiments/data/fetch.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/render/registry.h"
#include "toolkit/scene/scene.h"

namespace palpate::experiments {

[[nodiscard]] Error no_such_scan(const std::string& name);

/// Sets file and unit of every model that names a scan. With `fetch` a scan that is not here, or spoiled, is
/// fetched; without (null) it is an Error that says how to. What is fetched again is said in `notes`.
[[nodiscard]] Status find_scans(scene::SceneFile& scene, const FetchOptions* fetch, Progress& progress,
                                std::vector<std::string>& notes);

/// What the commands call SCENE, with its scans found and its [renderer] checked, whether it will be used or
/// not. The name of a scan is one too; a file wins over a scan of the same name.
[[nodiscard]] Result<scene::SceneFile> open_scene(const std::string& argument,
                                                  const render::Registry& registry, Progress& progress);

}  // namespace palpate::experiments
