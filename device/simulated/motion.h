// How a mass on a spring and a damper moves, driven by a motor that lags and by a goal: exact between two
// changes of what drives it, so that a simulated loop has the stability of the true one and none of its own.
#pragma once

#include "toolkit/core/vec.h"

namespace palpate::device {

/// 1 kg = 1e-3 N s^2/mm.
inline constexpr double kNS2PerMmPerKg = 1e-3;

/// Sub-steps of a servo's period in which friction's direction, the goal's velocity and the hand's force are
/// held: a hand turns by less than a degree in one.
inline constexpr double kSubStepsPerPeriod = 16.0;

/// M x'' = F + W - D x' - K (x - goal), F' = (command - F) / lag.
struct Plant {
  double mass_kg = 0.0;             ///< above 0
  double damping_n_s_per_mm = 0.0;  ///< D: of device and hand
  double stiffness_n_per_mm = 0.0;  ///< K: of the hand
  double lag_s = 0.0;               ///< of the motor; 0: none

  /// The fastest of its rates, 1/s: a step of 1/rate is as long as one may be for the series to converge.
  [[nodiscard]] double rate_hz() const noexcept;
};

struct Motion {
  Vec3 x_mm = Vec3::Zero();
  Vec3 v_mm_s = Vec3::Zero();
  Vec3 motor_n = Vec3::Zero();  ///< F: what the motor gives now
};

/// What drives it over one step.
struct Drive {
  Vec3 command_n = Vec3::Zero();  ///< held
  Vec3 goal_mm = Vec3::Zero();    ///< of the spring, at the beginning of the step
  Vec3 goal_mm_s = Vec3::Zero();  ///< its velocity, constant over the step
  Vec3 steady_n = Vec3::Zero();   ///< W: everything else that stays
};

/// The motion `dt_s` later, to a few roundings. Work grows with dt_s times the plant's rate; no allocation.
[[nodiscard]] Motion moved(const Plant& plant, const Motion& motion, const Drive& drive,
                           double dt_s) noexcept;

}  // namespace palpate::device
