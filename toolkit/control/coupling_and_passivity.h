// The stages between a renderer's force and the device: virtual coupling, time-domain passivity and force
// filtering.
#pragma once

#include <cstdint>
#include <optional>

#include <palpate/control.h>
#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::control {

// Virtual coupling (section 2.2.4, reference [76]; Colgate, Stanley and Brown 1995; Adams and Hannaford
// 1999): a spring and damper between device and god object, so that the device's load does not depend on the
// environment's stiffness.

/// k_c finite and above 0, b_c finite and not negative; else an Error names the wrong one.
[[nodiscard]] Status check(const Coupling& coupling);

/// Colgate's condition b > k_c T / 2 + b_c for a coupling on a device.
struct CouplingStability {
  bool passive = false;  ///< the condition holds: stable for any environment and hand
  double min_device_damping_n_s_per_mm =
      0.0;                              ///< k_c T / 2 + b_c, which the device's own damping must exceed
  double max_stiffness_n_per_mm = 0.0;  ///< 2 (b - b_c) / T, an upper bound on k_c; 0 if none is possible
};
/// `device_damping_n_s_per_mm` is b, the device's own friction-like damping; `period_s` is the servo's T.
[[nodiscard]] CouplingStability coupling_stability(const Coupling& coupling, double device_damping_n_s_per_mm,
                                                   double period_s) noexcept;

/// Spring k_c and damper b_c in parallel, in series with the model's spring: F = f + b_c d|g - h|/dt, along
/// the renderer's force.
/// h is the device, g the god object, F_r the renderer's force. The model's stiffness is |F_r| / |g - h|, and
/// two springs in series carry f = |F_r| k_c |g - h| / (k_c |g - h| + |F_r|): a rigid model feels like k_c, a
/// soft one stays soft, none is stiffer than k_c. The damper resists changes of the length |g - h|. Only the
/// renderer knows its surface's direction (with friction g - h is not the normal; at depth 0 it is zero), so
/// spring and damper act along its force only, never pulling the device to the surface.
class VirtualCoupling {
 public:
  explicit VirtualCoupling(const Coupling& coupling = {}) noexcept : coupling_(coupling) {}

  void reset() noexcept { last_length_mm_ = 0.0; }
  /// The force on the device; exactly zero without `contact`. Bounded work, no allocation; never NaN for
  /// finite arguments, zero for others.
  [[nodiscard]] Vec3 couple(const Vec3& hip_mm, const Vec3& god_object_mm, const Vec3& renderer_force_n,
                            bool contact, double dt_s) noexcept;
  [[nodiscard]] const Coupling& coupling() const noexcept { return coupling_; }

 private:
  Coupling coupling_;
  double last_length_mm_ = 0.0;  ///< in the last contact frame; 0 when free
};

// Time-domain passivity (Hannaford and Ryu, "Time-domain passivity control of haptic interfaces", IEEE
// Transactions on Robotics and Automation 18(1), 2002). The observer sums the energy put into the virtual
// environment; the controller damps away energy that the environment gave in excess.
//
// Signs: F acts on the device at position h; E = -(sum of F . dh) is the energy put *into* the environment,
// positive when the hand worked against the force. Passive so far: E >= 0. 1 N mm = 1 mJ.

/// A few operations a frame, no allocation. Ignores non-finite input.
class PassivityObserver {
 public:
  explicit PassivityObserver(EnergyRule rule = EnergyRule::kTrapezoid) noexcept : rule_(rule) {}

  /// Clears energy and the last frame.
  void reset() noexcept { *this = PassivityObserver(rule_); }
  /// The device at `hip_mm` gets `force_n`. The first call only sets the start.
  void observe(const Vec3& hip_mm, const Vec3& force_n) noexcept;
  /// The value of E after observe(hip_mm, force_n).
  [[nodiscard]] double energy_after_mj(const Vec3& hip_mm, const Vec3& force_n) const noexcept;
  /// Clears stored energy and keeps a debt.
  void forget_surplus() noexcept { energy_mj_ = energy_mj_ < 0.0 ? energy_mj_ : 0.0; }

  [[nodiscard]] double energy_mj() const noexcept { return energy_mj_; }
  [[nodiscard]] double min_energy_mj() const noexcept {
    return min_energy_mj_;
  }  ///< the minimum so far, at most 0
  [[nodiscard]] EnergyRule rule() const noexcept { return rule_; }
  [[nodiscard]] bool started() const noexcept { return started_; }
  [[nodiscard]] const Vec3& last_hip_mm() const noexcept { return last_hip_mm_; }
  /// Weight of F(n): 1/2, 1, 0.
  [[nodiscard]] double current_force_weight() const noexcept;

 private:
  EnergyRule rule_;
  bool started_ = false;
  Vec3 last_hip_mm_ = Vec3::Zero();
  Vec3 last_force_n_ = Vec3::Zero();
  double energy_mj_ = 0.0;
  double min_energy_mj_ = 0.0;
};

/// The passivity controller in series with a renderer: where E would fall below 0 it adds -alpha v with alpha
/// = -E / (w T v^2), which makes E exactly 0. w is the present force's weight (1 as printed; also 1 for
/// kHold, whose force counts in the next step, assuming constant velocity). Limited by the damping limit; the
/// rest, or all at rest, stays owed. In free space nothing is added, and stored energy is cleared: friction
/// losses must not pay for a later kick.
class PassivityController {
 public:
  explicit PassivityController(const PassivityOptions& options = {}) noexcept
      : options_(options), observer_(options.rule) {}

  void reset() noexcept { observer_.reset(); }
  /// The force to output for `wanted_n` at `hip_mm`, `dt_s` after the last frame; at most `limit_n` (0 =
  /// none). Never NaN: non-finite input gives zero. Bounded work, no allocation.
  [[nodiscard]] Vec3 control(const Vec3& hip_mm, const Vec3& wanted_n, double dt_s,
                             double limit_n = 0.0) noexcept;

  [[nodiscard]] const PassivityObserver& observer() const noexcept { return observer_; }  ///< of the output

 private:
  [[nodiscard]] Vec3 damping_n(const Vec3& hip_mm, const Vec3& wanted_n, double dt_s) const noexcept;

  PassivityOptions options_;
  PassivityObserver observer_;
};

// Force filtering (section 3.2.5): "restrictions on the current frame's force vector in relation to what the
// force vector in the previous frame looked like". The thesis gives only this sentence; the limits are ours,
// in a literal and a corrected form.

/// The thesis's haptic frame, which converts limits per second to limits per frame.
inline constexpr double kLiteralFrameS = 1e-3;

/// An Error names the limit that is negative or not finite.
[[nodiscard]] Status check(const ForceFilterOptions& options);

/// Limits direction, then rate: no force between the last and the turned one turns further, so both limits
/// hold. A filter delays (filter_delay) and is therefore active: it returns on the way out what it withheld
/// on the way in (figures in docs/reference/scene-keys.md).
class ForceFilter {
 public:
  explicit ForceFilter(const ForceFilterOptions& options = {}) noexcept : options_(options) {}

  void reset() noexcept { last_n_.setZero(); }
  /// The allowed force `dt_s` after the last. A non-finite wanted force counts as zero, dt_s <= 0 as no time.
  /// Bounded work, no allocation.
  [[nodiscard]] Vec3 filter(const Vec3& wanted_n, double dt_s) noexcept;
  [[nodiscard]] const ForceFilterOptions& options() const noexcept { return options_; }

 private:
  [[nodiscard]] Vec3 turned(const Vec3& wanted_n, double max_rad) const noexcept;

  ForceFilterOptions options_;
  Vec3 last_n_ = Vec3::Zero();
};

/// Test inputs for measuring a filter's delay.
struct FilterProbe {
  double step_n = 1.0;            ///< onset of contact: from 0 to this in one frame
  double ramp_n_per_s = 10.0;     ///< pressing in: 0.5 N/mm at 20 mm/s
  double step_deg = 10.0;         ///< a change of point: 0.2 mm aside at 1 mm depth is 11 degrees
  double ramp_deg_per_s = 100.0;  ///< sliding over a curved surface: 10 mm radius at 20 mm/s is 115
  double dt_s = 1e-3;
};

/// Times from the frame that wanted the step; 0 if it shows at once.
struct StepDelay {
  double to_63_percent_s = 0.0;
  double to_95_percent_s = 0.0;
  /// Final lag behind a steady ramp; nothing if it grows without end.
  std::optional<double> ramp_lag_s;
};
struct FilterDelay {
  StepDelay size;       ///< of a change of magnitude
  StepDelay direction;  ///< of a change of direction at step_n, which the rate limit delays too
};
/// Measured by running the filter. Errors: invalid options or probe (steps below a right angle, a ramp of at
/// least two frames), or a step not reached within kMeasuredFrames frames.
[[nodiscard]] Result<FilterDelay> filter_delay(const ForceFilterOptions& options, const FilterProbe& probe);
inline constexpr int kMeasuredFrames = 100'000;

}  // namespace palpate::control
