// `cloud-smooth`: a continuous god object on a smooth surface near the points, through their noise
// (docs/smooth.md).
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::render {

[[nodiscard]] RendererInfo cloud_smooth_info();

}  // namespace palpate::render
