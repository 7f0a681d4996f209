// Scenes that name a scan: where the scan's file lies is known here, not in the toolkit.
#pragma once

#include <string>

#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/scene/scene.h"

namespace palpate::experiments {

/// Sets file and unit of every model that names a scan. With `fetch` a scan that is not here is fetched, else
/// it is an Error that says how to.
[[nodiscard]] Status find_scans(scene::SceneFile& scene, bool fetch, Progress& progress);

/// What the commands call SCENE, with its scans found.
[[nodiscard]] Result<scene::SceneFile> open_scene(const std::string& argument, Progress& progress);

}  // namespace palpate::experiments
