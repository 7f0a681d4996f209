// `penalty-grid`: the patent of table 11 ([75]), from the thesis's description in section 2.2.3; the text of
// the patent is not known to us. The voxel that holds the HIP, the distance to each of its points, contact
// below a threshold, a penalty force. No neighbouring voxels, no inside test. The force law is ours:
// k (threshold - distance), away from the nearest point.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

[[nodiscard]] render::RendererInfo penalty_grid_info();

}  // namespace palpate::baselines
