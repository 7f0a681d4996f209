// `cloud` with surface=vertices: chapter 3's surface, a plane at every point, made right. What the step to
// stars is measured against.
#pragma once

#include <memory>

#include "toolkit/render/capabilities.h"
#include "toolkit/render/renderer.h"

namespace palpate::render {

inline constexpr Features kFeltOnVertices =
    kAllOfRigidSurfaces | Feature::kDent | Feature::kMovedPoints | Feature::kJointContact;

/// Editable too. `options`: complete, as of cloud_info().
[[nodiscard]] std::unique_ptr<HapticRenderer> make_cloud_on_vertices(const Options& options);

}  // namespace palpate::render
