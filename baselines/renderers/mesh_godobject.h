// `mesh-godobject`: Zilles and Salisbury's god object (1995) on a mesh, contact found by Embree.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

[[nodiscard]] render::RendererInfo mesh_godobject_info();

}  // namespace palpate::baselines
