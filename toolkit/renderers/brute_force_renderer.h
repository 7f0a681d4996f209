// `brute-force`: the obvious slow way, the oracle of tests. Every frame looks at every point.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::render {

[[nodiscard]] RendererInfo brute_force_info();

}  // namespace palpate::render
