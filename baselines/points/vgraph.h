// `vgraph`: the thesis's [51] by sections 2.2.3 and 3.6.3: a graph of neighbouring vertices leads greedily to
// the one nearest to the HIP, then the HIP's segment is tested against the triangles that share it. The
// response is ours, the thesis says only "presumably constraint-based": Zilles and Salisbury's god object,
// minimised over the triangles from the one that was entered (facet_walk.h).
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

[[nodiscard]] render::RendererInfo vgraph_info();

}  // namespace palpate::baselines
