// A servo loop and a drawing thread on one shared core, as without a core to spare. Measures tick lateness,
// step times and pictures.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/goals/point_image.h"

namespace palpate::experiments {

struct PinnedOptions {
  double seconds = 10.0;
  bool draw = false;  ///< a second thread on the same core draws the cloud
};

struct PinnedRun {
  int cpu = -1;                             ///< common core of both; -1: pinning was refused
  bool real_time = false;                   ///< the servo had SCHED_FIFO
  std::vector<std::string> not_obtained{};  ///< what the servo was refused, with remedies
  std::vector<std::int64_t> late_ns;        ///< by tick: start after due time
  std::vector<std::int64_t> step_ns;        ///< by tick: the renderer's frame, interruptions included
  std::uint64_t skipped_ticks = 0;          ///< passed before they could begin
  std::uint64_t images = 0, points_drawn = 0;
  double drawn_s = 0.0;  ///< running time of the drawing thread
  PointImage last;       ///< the last picture; empty if none
};

/// Steps the prepared renderer repeatedly along the path at 1 kHz in its own thread. Error: no thread.
/// Allocates before the first tick only.
[[nodiscard]] Result<PinnedRun> run_pinned(render::HapticRenderer& renderer, const trace::ProbePath& path,
                                           const cloud::Cloud& cloud, const PinnedOptions& options);

}  // namespace palpate::experiments
