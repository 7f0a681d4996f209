// Detects pop-throughs of a god object, as defined at Accuracy::pop_throughs.
#pragma once

#include <cstdint>
#include <vector>

#include <palpate/reference.h>
#include <palpate/trace.h>

namespace palpate::metrics {

/// Events per frame (at most two); consecutive frames of one state count once. Lengths must agree. At most
/// 130 distance queries a frame. Sheets thinner than two local resolutions are only caught by the facing-away
/// rule.
[[nodiscard]] std::vector<std::uint8_t> find_pop_throughs(const trace::ProbePath& path,
                                                          const trace::ForceTrace& trace,
                                                          const trace::ReferenceTrace& reference,
                                                          const TruthSurface& truth);

}  // namespace palpate::metrics
