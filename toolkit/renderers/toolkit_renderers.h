// The renderers that the toolkit brings, in one call.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::render {

/// Adds cloud-literal, cloud, cloud-smooth, heightfield-literal, heightfield, analytic and brute-force. None
/// of them may be there already.
void register_toolkit_renderers(Registry& registry);

}  // namespace palpate::render
