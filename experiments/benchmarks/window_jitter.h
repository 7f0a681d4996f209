// How late a servo's ticks begin with and without the window drawing beside it.
#pragma once

#include "experiments/window/window.h"
#include "toolkit/core/result.h"

namespace palpate::experiments {

struct JitterWanted {
  std::size_t points = 1'000'000;
  double seconds = 60.0;  ///< of each of the two
  double slice_s = 5.0;
  std::string renderer = "cloud";
};

/// Slices take turns, so that both see the same machine: the window turns its camera, which draws anew each
/// picture, or stands still. Prints a table: ticks, missed, faults, and lateness in us (p50, p99, p99.9,
/// most).
[[nodiscard]] Status measure_jitter(const JitterWanted& wanted);

}  // namespace palpate::experiments
