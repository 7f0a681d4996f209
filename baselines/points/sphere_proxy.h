// `sphere-proxy`: the bag of spheres that the open haptics library (CHAI3D 3.3) offers for point clouds:
// every point stops the centre of a spherical proxy at its radius, and the proxy moves among them as in
// Ruspini et al. 1997. Ours finds the proxy's place of rest in the frame, without that library's epsilons
// (ball_walk.h), so it neither lags nor jams.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

[[nodiscard]] render::RendererInfo sphere_proxy_info();

}  // namespace palpate::baselines
