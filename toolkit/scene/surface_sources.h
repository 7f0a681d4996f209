// What a model's surface takes from its file's columns, from images and from regions, turned into properties.
// Internal to scene.
#pragma once

#include "toolkit/scene/scene.h"

namespace palpate::scene {

/// Fills the surface of a loaded model. Errors name a column that the file does not have, or an image that
/// cannot be read or is no full grid; a region without a point is warned of. Images take at most `max_bytes`
/// of memory each. O(points x regions).
[[nodiscard]] Status resolve_surface(const SceneModel& model, const io::Readers& readers,
                                     std::uint64_t max_bytes, Progress& progress, render::ModelInput& input,
                                     std::vector<std::string>& warnings);

}  // namespace palpate::scene
