// The renderer `mesh-proxy`.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

/// Ruspini's sphere proxy (1997) on a triangle mesh, facets found by Embree; see sphere_probe.h. One sphere
/// for the whole scene. What make() gives is a MeshHolder too.
[[nodiscard]] render::RendererInfo mesh_proxy_info();

}  // namespace palpate::baselines
