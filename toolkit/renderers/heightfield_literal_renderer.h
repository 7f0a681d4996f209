// `heightfield-literal`: chapter 4 of the thesis to the letter. A point-in-box test on the posts' boxes, the
// entry cell remembered, the god object searched from there anew in every frame.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::render {

[[nodiscard]] RendererInfo heightfield_literal_info();

}  // namespace palpate::render
