// The renderer of docs/add-a-renderer.md.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::example {

void register_ball(render::Registry& registry);

}  // namespace palpate::example
