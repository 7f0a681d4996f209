// `sdf-godobject`: a god object on the zero set of a narrow-band signed distance grid made from the points.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

/// Source: a distance grid as graphics engineers make it today (OpenVDB, Museth 2013), distances to the local
/// planes of points (Hoppe et al. 1992, weighted); the god object of Zilles and Salisbury 1995 on it.
[[nodiscard]] render::RendererInfo sdf_godobject_info();

}  // namespace palpate::baselines
