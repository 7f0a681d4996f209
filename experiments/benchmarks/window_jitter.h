// Lateness of servo ticks with and without the window drawing.
#pragma once

#include <palpate/result.h>
#include "experiments/window/window.h"

namespace palpate::experiments {

struct JitterWanted {
  std::size_t points = 1'000'000;
  double seconds = 60.0;  ///< for each of the two
  double slice_s = 5.0;
  std::string renderer = "cloud";
};

/// Alternates slices so both see the same machine; the window turns its camera, redrawing each picture, or
/// stands still. Prints a table: ticks, missed, faults, lateness in us (p50, p99, p99.9, largest).
[[nodiscard]] Status measure_jitter(const JitterWanted& wanted);

}  // namespace palpate::experiments
