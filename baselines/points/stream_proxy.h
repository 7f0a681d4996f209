// `stream-proxy`: Ryden and Chizeck's proxy for streaming points (IEEE Transactions on Haptics 2013), from
// what is public of it: a proxy among points without any preparation beyond a grid, steered by how many
// points stand within three shells r1 < r2 < r3 around it and by their mean direction. Points that move
// (MoveQueue) are followed.
#pragma once

#include "toolkit/render/registry.h"

namespace palpate::baselines {

[[nodiscard]] render::RendererInfo stream_proxy_info();

}  // namespace palpate::baselines
