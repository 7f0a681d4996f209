// `cloud-literal`: chapter 3 of the thesis as printed, figures 36 and 42 to the letter, defects included
// (docs/thesis-notes.md lists them). The right form is `cloud`.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::render {

[[nodiscard]] RendererInfo cloud_literal_info();

}  // namespace palpate::render
