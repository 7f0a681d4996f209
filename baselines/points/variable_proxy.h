// `variable-proxy`: a spherical proxy whose radius follows the local density of the points.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

/// Source: Kumari, Sreeni and Chaudhuri (WHC 2013; arXiv 2020), from public descriptions.
[[nodiscard]] render::RendererInfo variable_proxy_info();

}  // namespace palpate::baselines
