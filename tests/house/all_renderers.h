// All renderers of this build: the toolkit's, and the baselines' if built.
#pragma once

#include <palpate/registry.h>

namespace palpate::house {

void register_all_renderers(render::Registry& registry);

}  // namespace palpate::house
