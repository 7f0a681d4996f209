// `cloud-smooth`: a continuous god object on a smooth surface near the points, through their noise
// (docs/smooth.md).
#pragma once

#include <memory>

#include "toolkit/render/registry.h"
#include "toolkit/smooth/smooth_without.h"

namespace palpate::render {

[[nodiscard]] RendererInfo cloud_smooth_info();
/// With steps of its making left out: for ablation. `options`: complete, as of cloud_smooth_info().
[[nodiscard]] std::unique_ptr<HapticRenderer> make_cloud_smooth(const Options& options,
                                                                const SmoothWithout& without);

}  // namespace palpate::render
