// Time-domain passivity (Hannaford and Ryu, "Time-domain passivity control of haptic interfaces", IEEE
// Transactions on Robotics and Automation 18(1), 2002). The observer sums the energy put into the virtual
// environment; the controller damps away energy that the environment gave in excess.
//
// Signs: F acts on the device at position h; E = -(sum of F . dh) is the energy put *into* the environment,
// positive when the hand worked against the force. Passive so far: E >= 0. 1 N mm = 1 mJ.
#pragma once

#include <cstdint>

#include <palpate/control.h>
#include <palpate/vec.h>

namespace palpate::control {

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

  void reset() noexcept {
    observer_.reset();
    damped_frames_ = 0;
  }
  /// The force to output for `wanted_n` at `hip_mm`, `dt_s` after the last frame; at most `limit_n` (0 =
  /// none). Never NaN: non-finite input gives zero. Bounded work, no allocation.
  [[nodiscard]] Vec3 control(const Vec3& hip_mm, const Vec3& wanted_n, double dt_s,
                             double limit_n = 0.0) noexcept;

  [[nodiscard]] const PassivityObserver& observer() const noexcept { return observer_; }  ///< of the output
  [[nodiscard]] std::uint64_t damped_frames() const noexcept { return damped_frames_; }

 private:
  [[nodiscard]] Vec3 damping_n(const Vec3& hip_mm, const Vec3& wanted_n, double dt_s) const noexcept;

  PassivityOptions options_;
  PassivityObserver observer_;
  std::uint64_t damped_frames_ = 0;
};

}  // namespace palpate::control
