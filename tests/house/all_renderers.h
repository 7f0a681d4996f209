// All renderers of this build: the toolkit's, and the baselines' if built.
#pragma once

#include <palpate/registry.h>

namespace palpate::house {

[[nodiscard]] render::Registry all_renderers();

}  // namespace palpate::house
