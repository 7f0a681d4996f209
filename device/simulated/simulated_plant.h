// Interface of simulated devices held by a hand: true position, shown force and energy.
#pragma once

#include <palpate/device/device.h>
#include <palpate/vec.h>
#include "device/simulated/hand_script.h"

namespace palpate::device {

// Motion of a mass on a spring and damper, driven by a lagging motor and a goal: exact between changes of the
// drive, so simulation adds no instability.

/// 1 kg = 1e-3 N s^2/mm.
inline constexpr double kNS2PerMmPerKg = 1e-3;

/// Sub-steps per servo period, in which friction's direction, the goal's velocity and the hand's force are
/// held: a hand turns less than a degree in one.
inline constexpr double kSubStepsPerPeriod = 16.0;

/// M x'' = F + W - D x' - K (x - goal), F' = (command - F) / lag.
struct Plant {
  double mass_kg = 0.0;             ///< above 0
  double damping_n_s_per_mm = 0.0;  ///< D, of device and hand
  double stiffness_n_per_mm = 0.0;  ///< K, of the hand
  double lag_s = 0.0;               ///< of the motor; 0: none

  /// Fastest rate, 1/s; the series converges for steps up to 1/rate.
  [[nodiscard]] double rate_hz() const noexcept;
};

struct Motion {
  Vec3 x_mm = Vec3::Zero();
  Vec3 v_mm_s = Vec3::Zero();
  Vec3 motor_n = Vec3::Zero();  ///< F: present motor force
};

struct Drive {
  Vec3 command_n = Vec3::Zero();  ///< constant
  Vec3 goal_mm = Vec3::Zero();    ///< of the spring, at the start of the step
  Vec3 goal_mm_s = Vec3::Zero();  ///< constant
  Vec3 steady_n = Vec3::Zero();   ///< W: all other constant force
};

/// The motion `dt_s` later, to a few roundings. Work grows with dt_s times the plant's rate; no allocation.
[[nodiscard]] Motion moved(const Plant& plant, const Motion& motion, const Drive& drive,
                           double dt_s) noexcept;

/// The hand: a mass on a spring and damper to its goal, and a constant push. All zero: nobody.
struct Hand {
  std::string name = "released";
  double mass_kg = 0.0;
  double damping_n_s_per_mm = 0.0;
  double stiffness_n_per_mm = 0.0;
  Vec3 push_n = Vec3::Zero();  ///< device frame
  /// The device follows the goal of an infinitely strong hand: a worst case.
  bool guides = false;
};

/// Energy since opening, mJ.
struct EnergyLedger {
  double motors = 0.0;    ///< given by the motors to the mechanism
  double damping = 0.0;   ///< taken by the device's own damping
  double friction = 0.0;  ///< taken by friction
  double kinetic = 0.0;   ///< of the device alone, now
  /// Energy given by the hand. Below 0 at the end of a cycle: the device was active and gave energy.
  [[nodiscard]] double hand() const noexcept { return kinetic + damping + friction - motors; }
};

class SimulatedPlant : public Device {
 public:
  /// True present position, device frame, without encoder.
  [[nodiscard]] virtual const Vec3& hip_mm() const noexcept = 0;
  /// Present motor force.
  [[nodiscard]] virtual const Vec3& motor_force_n() const noexcept = 0;
  [[nodiscard]] virtual EnergyLedger energy() const noexcept = 0;
  /// At rest under a constant goal: while what it shows and is sent stays bitwise the same, all else does
  /// too. False if unknown.
  [[nodiscard]] virtual bool at_rest() const noexcept { return false; }
};

}  // namespace palpate::device
