// `cloud` with surface=stars: the points' own triangles, see toolkit/stars/star_mesh.h.
#pragma once

#include <memory>

#include "toolkit/render/capabilities.h"
#include "toolkit/render/renderer.h"

namespace palpate::render {

inline constexpr Features kFeltOnStars =
    kAllOfRigidSurfaces | Feature::kDent | Feature::kMovedPoints | Feature::kJointContact;

/// Editable too. `options`: complete, as of cloud_info().
[[nodiscard]] std::unique_ptr<HapticRenderer> make_cloud_on_stars(const Options& options);

}  // namespace palpate::render
