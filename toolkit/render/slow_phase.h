// The slow half of a renderer, for those who run it on a loop of its own (reference [77], section 2.2.4).
#pragma once

#include "toolkit/core/vec.h"

namespace palpate::render {

class SlowPhase {
 public:
  virtual ~SlowPhase() = default;
  /// From now on the caller runs slow_phase() at its own rate, on one thread of its own or between frames;
  /// until then the frames run it themselves when they need it. Before the first frame. A frame that finds
  /// the last answer too old looks at every model, and counts a bound hit.
  virtual void run_slow_phase_elsewhere() noexcept = 0;
  /// Looks for the models around the way from one HIP to the next (world, mm) at that time; hands them over
  /// without a lock.
  virtual void slow_phase(double t_s, const Vec3& from_mm, const Vec3& to_mm) noexcept = 0;
};

}  // namespace palpate::render
