// `heightfield`: chapter 4 of the thesis made right. The god object is the nearest point of the bilinear
// surface over the posts, followed from frame to frame; the HIP's path is tested, not its places, so that no
// peak is passed through unfelt.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::render {

[[nodiscard]] RendererInfo heightfield_info();

}  // namespace palpate::render
