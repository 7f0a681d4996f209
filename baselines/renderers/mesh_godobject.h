// The renderer `mesh-godobject`.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

/// Zilles and Salisbury (1995) on a triangle mesh; see facet_walk.h for the god object, segment_index.h for
/// entries, mesh_probe.h for contact. What make() gives is a MeshHolder too.
[[nodiscard]] render::RendererInfo mesh_godobject_info();

}  // namespace palpate::baselines
