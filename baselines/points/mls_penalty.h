// `mls-penalty`: Lee and Kim 2007, the thesis's [52]: a hierarchy of swept spheres finds the points near the
// HIP, a moving-least-squares surface is built through them in the frame, and the force is k x depth along
// its normal. The projection is Alexa and Adamson's; the paper's own text is not public.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

[[nodiscard]] render::RendererInfo mls_penalty_info();

}  // namespace palpate::baselines
