// `vector-field`: the first kind of response of the thesis's section 2.2.2: a force for every place in space,
// looked up by position alone. Prepared from the distance to the points' planes on a voxel grid of which only
// bricks near the surface are kept. Shows what it costs not to know where the HIP came from.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

[[nodiscard]] render::RendererInfo vector_field_info();

}  // namespace palpate::baselines
