// The renderer of docs/tutorials/your-renderer.md.
#pragma once

#include <palpate/registry.h>

namespace palpate::example {

void register_ball(render::Registry& registry);

}  // namespace palpate::example
