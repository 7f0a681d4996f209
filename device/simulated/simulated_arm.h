// An impedance device without hardware: an arm with mass, damping, Coulomb friction, encoders and motors, and
// a hand on it that has its own mass, damping and spring to a goal. Position out, force in; the force feeds
// back. Numbers of known devices: arm_models.h.
#pragma once

#include <vector>

#include "device/simulated/motion.h"
#include "device/simulated/simulated_plant.h"
#include "toolkit/core/clock.h"

namespace palpate::device {

struct ArmOptions {
  std::string name = "arm";
  double mass_kg = 0.045;
  double damping_n_s_per_mm = 0.0003;
  double friction_n = 0.0;      ///< Coulomb, against the motion, in any direction
  double encoder_mm = 0.0;      ///< step of the measured position along each axis; 0: exact
  double force_max_n = 3.3;     ///< the motors saturate here, direction kept
  double force_step_n = 0.0;    ///< of the motor command along each axis; 0: exact
  double lag_s = 0.0;           ///< of the motors, first order; 0: none
  double delay_s = 0.0;         ///< from the reading of a position to the motor's command
  double period_s = 1e-3;       ///< of the servo: what the physics' steps are derived from
  double workspace_mm = 100.0;  ///< half of the box
};

/// Linear motion is exact between changes of the drive; friction's direction and the goal's velocity are held
/// over a sub-step, a 16th of the servo's period at most. A stop is found within it; at rest the mechanism
/// stays where the net force is below friction. Commands arrive in order, `delay_s` after they were sent, at
/// most kMostInFlight of them on the way. The same on every machine: no sin, no cos, no clock but the one
/// given. Keeps references to clock and script.
class SimulatedArm final : public SimulatedPlant {
 public:
  SimulatedArm(const ArmOptions& options, const Hand& hand, const HandScript& script, const Clock& clock);

  [[nodiscard]] std::string name() const override { return "sim:" + options_.name; }
  /// An Error names the option that is not right.
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override;
  /// Moves the arm to the clock's time and measures.
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce force) noexcept override;

  [[nodiscard]] const Vec3& hip_mm() const noexcept override { return motion_.x_mm; }
  [[nodiscard]] const Vec3& velocity_mm_s() const noexcept { return motion_.v_mm_s; }
  [[nodiscard]] const Vec3& shown_n() const noexcept override { return motion_.motor_n; }
  [[nodiscard]] EnergyLedger energy() const noexcept override;
  [[nodiscard]] bool at_rest() const noexcept override;

  static constexpr std::size_t kMostInFlight = 256;  // 16 kHz over 16 ms of delay

 private:
  struct Command {
    double due_s = 0.0;
    Vec3 force_n = Vec3::Zero();
  };
  void advance_to(double t_s) noexcept;
  void advance_by(double dt_s) noexcept;
  void sub_step(double h_s) noexcept;
  void guided_step(double h_s) noexcept;
  [[nodiscard]] double slide(double h_s, const Drive& drive) noexcept;
  void account(const Motion& to, double h_s, const Vec3& friction_n) noexcept;
  [[nodiscard]] Vec3 as_motor(const Vec3& force_n) const noexcept;
  void hold(bool held) noexcept;

  ArmOptions options_;
  Hand hand_;
  const HandScript& script_;
  const Clock& clock_;
  bool open_ = false, held_ = true;
  double opened_s_ = 0.0, now_s_ = 0.0, last_read_s_ = -1.0;
  Plant plant_;
  Motion motion_;
  Vec3 command_n_ = Vec3::Zero();
  std::vector<Command> in_flight_;  // a ring
  std::size_t first_ = 0, waiting_ = 0;
  EnergyLedger ledger_;
};

}  // namespace palpate::device
