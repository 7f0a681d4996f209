// Resolves surface properties from columns, images and regions. Internal to scene.
#pragma once

#include <palpate/scene.h>

namespace palpate::scene {

/// Fills the surface of a loaded model. Errors: a missing column, an image that is unreadable or no full
/// grid. An empty region gives a warning. Each image takes at most `max_bytes`. O(points x regions).
[[nodiscard]] Status resolve_surface(const SceneModel& model, const io::Readers& readers,
                                     std::uint64_t max_bytes, Progress& progress, render::ModelInput& input,
                                     std::vector<std::string>& warnings);

}  // namespace palpate::scene
