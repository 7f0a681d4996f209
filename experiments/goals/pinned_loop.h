// A servo loop and a drawing thread that share one core, as on a machine that has no other to spare: how late
// the ticks are, how long the steps take, and how many pictures there are.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/goals/point_image.h"
#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/trace.h"

namespace palpate::experiments {

struct PinnedOptions {
  double seconds = 10.0;
  bool draw = false;  ///< a second thread draws the cloud, on the same core
};

struct PinnedRun {
  int cpu = -1;                             ///< that both were pinned to; -1: that was not allowed
  bool real_time = false;                   ///< the servo had SCHED_FIFO
  std::vector<std::string> not_obtained{};  ///< what was refused to the servo, with its remedy
  std::vector<std::int64_t> late_ns;        ///< by tick: when it began, after it was due
  std::vector<std::int64_t> step_ns;        ///< by tick: the renderer's frame, what interrupted it included
  std::uint64_t skipped_ticks = 0;          ///< that were over before they could begin
  std::uint64_t images = 0, points_drawn = 0;
  double drawn_s = 0.0;  ///< as long as the drawing thread ran
  PointImage last;       ///< the last picture; empty where none was drawn
};

/// Steps the prepared renderer at 1 kHz along the path, over and over, in a thread of its own. An Error where
/// a thread cannot be made. Allocates before the first tick alone.
[[nodiscard]] Result<PinnedRun> run_pinned(render::HapticRenderer& renderer, const trace::ProbePath& path,
                                           const cloud::Cloud& cloud, const PinnedOptions& options);

}  // namespace palpate::experiments
