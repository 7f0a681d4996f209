// Runs a renderer under a simulated hand. Servo, governor, device and clock run for the length of a script.
#pragma once

#include <cstdint>
#include <vector>

#include <palpate/device/servo.h>
#include <palpate/trace.h>
#include "device/simulated/simulated_arm.h"

namespace palpate::device {

struct LoopOptions {
  double period_s = 1e-3;
  double jitter_s = 0.0;  ///< each tick is late by up to this, uniform; below the period
  std::uint64_t seed = 1;
  double duration_s = 1.0;
  double slew_n_per_s = 1000.0;  ///< of the governor
  double soft_start_s = 0.05;    ///< of the governor: ends before a scripted hand arrives
  /// Above 0: stops simulating once nothing has changed bitwise for this long (and for kMinStillTicks, with
  /// the device at rest). The remaining ticks copy the last one and are not counted in `slewed` and
  /// `clamped`. Gives the same run for renderers that from then on answer a HIP at rest identically. The time
  /// must exceed the device's delay.
  double still_s = 0.0;
  geometry::RigidTransform world_from_device;
};

/// Renderers finish deferred work within 30 frames at one place; this is twice that.
inline constexpr std::size_t kMinStillTicks = 60;

/// One entry per tick; world frame.
struct LoopRun {
  trace::ProbePath hip;               ///< true position of the device
  trace::ProbePath measured;          ///< position seen by the renderer
  trace::ForceTrace felt;             ///< the renderer's answers
  std::vector<Vec3> sent_n;           ///< output of the governor
  std::vector<Vec3> motor_force_n;    ///< shown by the motors at the tick, from earlier commands
  Fault fault = Fault::kNone;         ///< that ended the run
  std::uint64_t slewed = 0;           ///< frames at the governor's slew limit
  std::uint64_t clamped = 0;          ///< at the magnitude limit
  EnergyLedger energy;                ///< at the end
  double least_environment_mj = 0.0;  ///< least energy put into the environment, by the motors' force
};

/// Runs the loop. The device's first position must be free. An Error for invalid options or a device that
/// does not open. Allocates only before the first tick.
[[nodiscard]] Result<LoopRun> run_loop(render::HapticRenderer& renderer, SimulatedPlant& device,
                                       VirtualClock& clock, const LoopOptions& options);

/// Swing of a coordinate at the end of a run about its linear trend, in two windows: the last second, and the
/// second that ended two seconds earlier.
struct Swing {
  double amplitude_mm = 0.0;  ///< half peak-to-peak in the last window
  double frequency_hz = 0.0;  ///< in the last window; 0: no swing
  bool sustained = false;     ///< above `quiet_mm` and not dying away
};
/// `along`: direction examined. A run shorter than the windows has no swing. O(ticks).
[[nodiscard]] Swing swing_of(const trace::ProbePath& path, const Vec3& along, double quiet_mm);

// Stability limits of a sampled spring on a device, to check simulations against. SI in the sources, mm here.

/// The largest passive stiffness, stable under any hand, without delay and lag: b > K T / 2 + |B| (Colgate
/// and Schenkel 1997), and K <= 2 f / step with an encoder (Abbott and Okamura 2005; Diolaiti and others
/// 2006). B is the wall's damping, from position differences. 0 if none.
[[nodiscard]] double passive_stiffness_n_per_mm(double damping_n_s_per_mm, double wall_damping_n_s_per_mm,
                                                double friction_n, double encoder_mm,
                                                double period_s) noexcept;

struct LinearLoop {
  Plant plant;  ///< of device and hand
  double period_s = 1e-3;
  double delay_s = 0.0;  ///< at most kMaxPeriodsOfDelay periods
  double wall_damping_n_s_per_mm = 0.0;
};
inline constexpr int kMaxPeriodsOfDelay = 64;
/// The exact limit of the linear loop with mass, spring, damper and lag; F(n) = -K x(n) - B (x(n) - x(n-1)) /
/// T is held from n T + delay on. Stable: all eigenvalues of one period are inside the unit circle. Returns
/// the least unstable stiffness above `least_n_per_mm`, to a millionth; infinite if none below 1e6 times
/// that. Not for frames.
[[nodiscard]] double linear_stiffness_n_per_mm(const LinearLoop& loop, double least_n_per_mm = 1e-3);
/// Largest eigenvalue magnitude of one period.
[[nodiscard]] double spectral_radius(const LinearLoop& loop, double stiffness_n_per_mm);

}  // namespace palpate::device
