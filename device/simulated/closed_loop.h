// A renderer under a simulated hand: servo, governor, device and clock put together, as long as a script
// lasts, and what is seen of it.
#pragma once

#include <cstdint>
#include <vector>

#include "device/servo/servo.h"
#include "device/simulated/simulated_plant.h"
#include "toolkit/trace/trace.h"

namespace palpate::device {

struct LoopOptions {
  double period_s = 1e-3;
  double jitter_s = 0.0;  ///< each tick is late by up to so much, uniform; below the period
  std::uint64_t seed = 1;
  double duration_s = 1.0;
  double slew_n_per_s = 1000.0;  ///< of the governor
  double soft_start_s = 0.05;    ///< of the governor: over before a scripted hand arrives
  /// Above 0: once nothing has changed to the bit for so long (and for kLeastStillTicks, and with the device
  /// at rest), the ticks that are left are written down like the last one and not simulated, nor counted in
  /// `slewed` and `clamped`. Otherwise the same run, for renderers that answer a HIP at rest the same for
  /// good once they have done so for this long. Longer than the device's delay.
  double still_s = 0.0;
  geometry::RigidTransform world_from_device;
};

/// What a frame of ours leaves for the next ones is done after 30 of them at one place: twice that.
inline constexpr std::size_t kLeastStillTicks = 60;

/// One entry a tick; world frame.
struct LoopRun {
  trace::ProbePath hip;               ///< where the device truly was
  trace::ProbePath measured;          ///< what the renderer saw of it
  trace::ForceTrace felt;             ///< what the renderer answered
  std::vector<Vec3> sent_n;           ///< what left the governor
  std::vector<Vec3> shown_n;          ///< what the motors showed at the tick, of earlier commands
  Fault fault = Fault::kNone;         ///< ended the run
  std::uint64_t slewed = 0;           ///< frames at the governor's slew limit
  std::uint64_t clamped = 0;          ///< frames at its magnitude limit
  EnergyLedger energy;                ///< at the end
  double least_environment_mj = 0.0;  ///< least energy put into the environment, by what the motors showed
};

/// Runs it. The device's first position must be free. Errors: options that are not right, a device that does
/// not open. Allocates before the first tick alone.
[[nodiscard]] Result<LoopRun> run_loop(render::HapticRenderer& renderer, SimulatedPlant& device,
                                       VirtualClock& clock, const LoopOptions& options);

/// How a coordinate swings at the end of a run, its straight trend taken away: in its last second, and in the
/// one that ended two seconds before that one did.
struct Swing {
  double amplitude_mm = 0.0;  ///< half of peak to peak in the last window
  double earlier_mm = 0.0;    ///< the same two seconds before
  double frequency_hz = 0.0;  ///< of the last window; 0: it does not swing
  bool sustained = false;     ///< above `quiet_mm`, and not dying away
};
/// `along` is the direction looked at. A run shorter than the windows has no swing. O(ticks).
[[nodiscard]] Swing swing_of(const trace::ProbePath& path, const Vec3& along, double quiet_mm);

}  // namespace palpate::device
