// What is up in pictures of a scene: [view] of its file. No force and no score depends on it.
#pragma once

#include <string>

#include "toolkit/core/result.h"

namespace palpate::scene {

/// What [view] says is up, "y" or another of z, x, -z, -y and -x; empty: it says nothing, or SCENE is no
/// scene file. Errors: those of reading the file. O(the file).
[[nodiscard]] Result<std::string> up_of_scene(const std::string& scene);

}  // namespace palpate::scene
