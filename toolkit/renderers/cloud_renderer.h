// `cloud`: chapter 3 of the thesis made right. The same surface (touching boxes to be found by, points to
// rest on), a contact state with a side that cannot stick, boxes of adjacent cells searched too, bounded
// work.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::render {

[[nodiscard]] RendererInfo cloud_info();

}  // namespace palpate::render
