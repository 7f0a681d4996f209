// Pop-throughs of a rendered god object: the definition stands at Accuracy::pop_throughs.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/metrics/truth.h"
#include "toolkit/trace/trace.h"

namespace palpate::metrics {

/// Events at each frame of the path (two at most); consecutive frames of one and the same state count once.
/// Lengths must agree. At most 130 distance queries a frame. A sheet thinner than two local resolutions is
/// seen only by the facing-away rule.
[[nodiscard]] std::vector<std::uint8_t> find_pop_throughs(const trace::ProbePath& path,
                                                          const trace::ForceTrace& trace,
                                                          const trace::ReferenceTrace& reference,
                                                          const TruthSurface& truth);

}  // namespace palpate::metrics
