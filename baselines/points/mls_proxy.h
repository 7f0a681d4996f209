// `mls-proxy`: Leeper, Chan and Salisbury 2012: the points define an implicit surface (metaballs, or moving
// least squares over oriented points), and a proxy is kept on it while the HIP is inside. Constants are
// those of the authors' public program.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

[[nodiscard]] render::RendererInfo mls_proxy_info();

}  // namespace palpate::baselines
