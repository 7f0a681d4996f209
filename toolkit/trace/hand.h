// A simulated hand that feels what it touches, and the path of its HIP; see paths.h. Internal to trace.
#pragma once

#include "toolkit/trace/paths.h"

namespace palpate::trace {

/// Options of `hand`, validated.
struct HandOptions {
  std::size_t frames = 0;
  double rate_hz = 0.0;
  double force_n = 0.0;  ///< the hardest press
  double slowest_mm_s = 0.0, fastest_mm_s = 0.0;
  double bandwidth_hz = 0.0;  ///< of the hand against the stiffness that is felt
  std::uint64_t seed = 0;
};

/// HIP positions in the model frame.
///
/// The hand presses along what it feels with a slowly changing force, drags along a wandering heading, lifts
/// every few seconds and sometimes taps. HIP and hand are a damper, v = (hand + force) / b, b chosen so that
/// its corner with target.stiffness_n_per_mm lies at bandwidth_hz: a person's arm does not follow more than
/// some 10 Hz, and no oscillation of the loop is mistaken for the surface's. Where nothing is felt it goes by
/// the points that it sees: above them down, at the border of an open scan back to where it was. The depth
/// is never much more than force_n over the stiffness, so that what is right is beyond argument in every
/// frame. `target.felt` must be set. O(frames).
[[nodiscard]] Result<std::vector<Vec3>> by_hand(const PathTarget& target, const HandOptions& options);

}  // namespace palpate::trace
