// Time-domain passivity (Hannaford and Ryu, "Time-domain passivity control of haptic interfaces", IEEE
// Transactions on Robotics and Automation 18(1), 2002): an observer that sums the energy put into the virtual
// environment, and a controller that takes back by damping what the environment gave beyond what it got.
//
// Signs: F acts on the device, h is the device's position; E = -(sum of F . dh) is the energy put *into* the
// virtual environment, positive where the hand has worked against the force. Passive so far: E >= 0. 1 N mm
// = 1 mJ.
#pragma once

#include <cstdint>

#include "toolkit/core/vec.h"

namespace palpate::control {

/// Which force counts over the step from h(n-1) to h(n).
enum class EnergyRule : std::uint8_t {
  /// The mean of F(n-1) and F(n): the renderer alone. Exact on a path of straight pieces for every force that
  /// is linear along them, hence for a spring: it returns to 0 on every closed path.
  kTrapezoid,
  /// F(n), as printed (f(n) v(n) T, with the velocity of the step just ended). On a spring it counts k dh^2 /
  /// 2 too much in every step.
  kPrinted,
  /// F(n-1): what a device does that holds a force until the next. Exact there on any path; on a spring k
  /// dh^2 / 2 too little in every step, which is the energy leak of sampling.
  kHold,
};

/// Work: a few operations a frame, no allocation. What is not finite is passed over.
class PassivityObserver {
 public:
  explicit PassivityObserver(EnergyRule rule = EnergyRule::kTrapezoid) noexcept : rule_(rule) {}

  /// Nothing stored, nothing known of the last frame.
  void reset() noexcept { *this = PassivityObserver(rule_); }
  /// The device is at `hip_mm` and gets `force_n`. The first call gives the start alone.
  void observe(const Vec3& hip_mm, const Vec3& force_n) noexcept;
  /// What E would be after observe(hip_mm, force_n).
  [[nodiscard]] double energy_after_mj(const Vec3& hip_mm, const Vec3& force_n) const noexcept;
  /// The energy is gone: forgets what was stored, and keeps what is owed.
  void forget_surplus() noexcept { energy_mj_ = energy_mj_ < 0.0 ? energy_mj_ : 0.0; }

  [[nodiscard]] double energy_mj() const noexcept { return energy_mj_; }
  [[nodiscard]] double least_mj() const noexcept { return least_mj_; }  ///< the least so far, at most 0
  [[nodiscard]] EnergyRule rule() const noexcept { return rule_; }
  [[nodiscard]] bool started() const noexcept { return started_; }
  [[nodiscard]] const Vec3& last_hip_mm() const noexcept { return last_hip_mm_; }
  /// The part of F(n) that counts: 1/2, 1, 0.
  [[nodiscard]] double weight_of_now() const noexcept;

 private:
  EnergyRule rule_;
  bool started_ = false;
  Vec3 last_hip_mm_ = Vec3::Zero();
  Vec3 last_force_n_ = Vec3::Zero();
  double energy_mj_ = 0.0;
  double least_mj_ = 0.0;
};

/// The damping advised for the smallest common device, the Phantom Omni, N s/mm: more makes it rattle.
inline constexpr double kDampingLimitNSPerMm = 0.005;

struct PassivityOptions {
  EnergyRule rule = EnergyRule::kTrapezoid;
  double damping_limit_n_s_per_mm = kDampingLimitNSPerMm;
};

/// The passivity controller in series with a renderer: where E would fall below 0 it adds -alpha v with the
/// alpha that makes it exactly 0, alpha = -E / (w T v^2), w the weight of the present force (1 as printed;
/// for kHold, whose present force counts only in the next step, 1 too, on the guess that the velocity stays).
/// At most the damping limit; what that leaves, or a device at rest, is owed and taken later. In free space
/// nothing is added (a free probe feels nothing) and what is stored is forgotten: what friction took must not
/// pay for a kick later.
class PassivityController {
 public:
  explicit PassivityController(const PassivityOptions& options = {}) noexcept
      : options_(options), observer_(options.rule) {}

  void reset() noexcept {
    observer_.reset();
    damped_frames_ = 0;
  }
  /// The force to give instead of `wanted_n` at `hip_mm`, `dt_s` after the last frame; at most `limit_n` (0 =
  /// none). Never NaN: what is not finite in gives no force out. Bounded work, no allocation.
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
