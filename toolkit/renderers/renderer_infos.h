// Registry entries of the toolkit's renderers: name, options, features, maker.
#pragma once

#include <palpate/registry.h>

namespace palpate::render {

[[nodiscard]] RendererInfo cloud_info();
/// `brute-force`, the tests' oracle: `cloud` without a search structure. Each query reads all triangles and
/// nothing is remembered between frames; only the walk on them is shared.
[[nodiscard]] RendererInfo brute_force_info();

[[nodiscard]] RendererInfo cloud_literal_info();

[[nodiscard]] RendererInfo cloud_smooth_info();

[[nodiscard]] RendererInfo heightfield_literal_info();

[[nodiscard]] RendererInfo heightfield_info();

[[nodiscard]] RendererInfo depth_image_info();

[[nodiscard]] RendererInfo analytic_info();

}  // namespace palpate::render
