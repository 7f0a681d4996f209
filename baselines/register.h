// What this library adds to the registry.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

/// Adds mesh-godobject.
void register_baseline_renderers(render::Registry& registry);

}  // namespace palpate::baselines
