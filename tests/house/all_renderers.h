// Every renderer of this build: the toolkit's, and the baselines' where they are built.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::house {

void register_all_renderers(render::Registry& registry);

}  // namespace palpate::house
