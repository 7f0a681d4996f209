// Strokes as hands make them: far off the surface, down at one of many speeds, along, and off again. Internal
// to trace.
#pragma once

#include <vector>

#include "toolkit/trace/path_shapes.h"

namespace palpate::trace {

struct StrokeOptions {
  double slowest_mm_s = 0.0, fastest_mm_s = 0.0;
  double impacts = 0.0;  ///< share of the strokes that hit the surface at the fastest speed
};

/// One pace a frame of `timing`. Each stroke has a speed of its own, evenly over its logarithm, and leaves by
/// clearance_mm to half as much again; what is free is done at the fastest speed, so that slow strokes last
/// no longer than period_frames: they are as shallow as that takes. An impact goes straight down to depth_mm
/// at the fastest speed, from all the way up; every other one bounces off at once.
[[nodiscard]] std::vector<Pace> strokes(const Timing& timing, const StrokeOptions& options);

}  // namespace palpate::trace
