// Simulated devices held by a hand, with known truth. They give true position, shown force and energy. The
// impedance device is an arm with mass, damping, Coulomb friction, encoders and motors, held by a hand with
// mass, damping and a spring to a goal; position out, force in. An admittance device and the parameters of
// known devices are here too.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/drivers.h>
#include <palpate/result.h>
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

/// A device held by a hand; moves when it is read. Keeps references to clock and script.
class SimulatedPlant : public Device {
 public:
  SimulatedPlant(const Hand& hand, const HandScript& script, const Clock& clock)
      : hand_(hand), script_(script), clock_(clock) {}

  /// Moves the device to the clock's time and measures.
  [[nodiscard]] DeviceState read() noexcept final;
  /// True present position, device frame, without encoder.
  [[nodiscard]] const Vec3& hip_mm() const noexcept { return motion_.x_mm; }
  /// Present motor force.
  [[nodiscard]] virtual const Vec3& motor_force_n() const noexcept = 0;
  [[nodiscard]] virtual EnergyLedger energy() const noexcept = 0;
  /// At rest under a constant goal: while what it shows and is sent stays bitwise the same, all else does
  /// too. False if unknown.
  [[nodiscard]] virtual bool at_rest() const noexcept { return false; }

 protected:
  /// Opens at the script's first goal, at rest.
  void start() noexcept;
  virtual void advance_to(double t_s) noexcept = 0;
  [[nodiscard]] virtual Vec3 measured_mm() const noexcept = 0;

  Hand hand_;
  const HandScript& script_;
  const Clock& clock_;
  bool open_ = false;
  double opened_s_ = 0.0, now_s_ = 0.0, last_read_s_ = -1.0;
  Motion motion_;
  EnergyLedger ledger_;
};

struct ArmOptions {
  std::string name = "arm";
  double mass_kg = 0.045;
  double damping_n_s_per_mm = 0.0003;
  double friction_n = 0.0;      ///< Coulomb, against the motion, isotropic
  double encoder_mm = 0.0;      ///< measured step per axis; 0: exact
  double force_max_n = 3.3;     ///< saturation of the motors, direction kept
  double force_step_n = 0.0;    ///< motor command step per axis; 0: exact
  double lag_s = 0.0;           ///< of the motors, first order; 0: none
  double delay_s = 0.0;         ///< from reading a position to the motor's command
  double period_s = 1e-3;       ///< of the servo; sets the physics steps
  double workspace_mm = 100.0;  ///< half side of the box
};

/// Linear motion is exact between changes of the drive. Friction's direction and the goal's velocity are held
/// over a sub-step, at most a 16th of the servo's period, in which a stop is located; at rest the mechanism
/// stays while the net force is below friction. Commands arrive in order `delay_s` after sending, at most
/// kMaxInFlight pending. The same on every machine: no sin, no cos, no clock but the given one.
class SimulatedArm final : public SimulatedPlant {
 public:
  SimulatedArm(const ArmOptions& options, const Hand& hand, const HandScript& script, const Clock& clock);

  [[nodiscard]] std::string name() const override { return "sim:" + options_.name; }
  /// An Error names the invalid option.
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override;
  void send(GovernedForce force) noexcept override;

  [[nodiscard]] const Vec3& velocity_mm_s() const noexcept { return motion_.v_mm_s; }
  [[nodiscard]] const Vec3& motor_force_n() const noexcept override { return motion_.motor_n; }
  [[nodiscard]] EnergyLedger energy() const noexcept override;
  [[nodiscard]] bool at_rest() const noexcept override;

  static constexpr std::size_t kMaxInFlight = 256;  // 16 kHz over 16 ms of delay

 private:
  struct Command {
    double due_s = 0.0;
    Vec3 force_n = Vec3::Zero();
  };
  void advance_to(double t_s) noexcept override;
  [[nodiscard]] Vec3 measured_mm() const noexcept override;
  void advance_by(double dt_s) noexcept;
  void sub_step(double h_s) noexcept;
  void guided_step(double h_s) noexcept;
  [[nodiscard]] double slide(double h_s, const Drive& drive) noexcept;
  void account(const Motion& to, double h_s, const Vec3& friction_n) noexcept;
  [[nodiscard]] Vec3 as_motor(const Vec3& force_n) const noexcept;
  void hold(bool held) noexcept;

  ArmOptions options_;
  bool held_ = true;
  Plant plant_;
  Vec3 command_n_ = Vec3::Zero();
  std::vector<Command> in_flight_;  // a ring
  std::size_t first_ = 0, waiting_ = 0;
};

// A simulated admittance device: it measures the hand's force and moves like a virtual damped mass under that
// force and the renderer's (force in, motion out; section 2.2.4 of the thesis, table 5). Interface as of
// impedance devices: position out, governed force in.

/// Defaults: a heavy, strong, stiff robot of the HapticMaster class (van der Linde and others 2002), virtual
/// mass 2 kg, 100 N. Drive bandwidth and virtual damping are assumed.
struct AdmittanceOptions {
  std::string name = "admittance";
  double mass_kg = 2.0;               ///< felt by the hand in free space
  double damping_n_s_per_mm = 0.005;  ///< likewise
  double bandwidth_hz = 50.0;         ///< of the position drives, critically damped; 0: immediate
  double force_max_n = 100.0;         ///< of the renderer's force
  double speed_max_mm_s = 1000.0;
  double period_s = 1e-3;
  double workspace_mm = 200.0;
};

/// Each frame, semi-implicit: v += T (hand + renderer - B v) / M moves the virtual mass. read() returns its
/// position: renderer and mass meet in the controller, without encoder and drives between. The drives follow
/// it and carry the hand, a spring and damper to its goal. The hand's own mass is behind these and not
/// measured.
class SimulatedAdmittance final : public SimulatedPlant {
 public:
  SimulatedAdmittance(const AdmittanceOptions& options, const Hand& hand, const HandScript& script,
                      const Clock& clock)
      : SimulatedPlant(hand, script, clock), options_(options) {}

  [[nodiscard]] std::string name() const override { return "sim:" + options_.name; }
  [[nodiscard]] Status open() override;
  void close() noexcept override { open_ = false; }
  [[nodiscard]] DeviceLimits limits() const noexcept override;
  void send(GovernedForce force) noexcept override;

  /// Force felt by the hand: the opposite of its own.
  [[nodiscard]] const Vec3& motor_force_n() const noexcept override { return shown_n_; }
  [[nodiscard]] EnergyLedger energy() const noexcept override { return ledger_; }

 private:
  [[nodiscard]] Vec3 hand_n(double t_s) const noexcept;
  void advance_to(double t_s) noexcept override;
  [[nodiscard]] Vec3 measured_mm() const noexcept override { return goal_mm_; }

  AdmittanceOptions options_;
  double last_sent_s_ = 0.0;
  Vec3 goal_mm_ = Vec3::Zero(), goal_mm_s_ = Vec3::Zero();  // of the drives
  Vec3 shown_n_ = Vec3::Zero();
};

// Published parameters of known devices and hands; none is measured here. Each states its source and
// assumptions.

/// "omni", "touch", "falcon", "omega3".
[[nodiscard]] const std::vector<ArmOptions>& arm_models();
/// "released", "hand", "finger", "arm".
[[nodiscard]] const std::vector<Hand>& hand_models();
[[nodiscard]] const AdmittanceOptions& admittance_model();

struct SimulatedRig {
  std::optional<ArmOptions> arm;  ///< empty: the admittance device
  Hand hand;

  [[nodiscard]] std::string device_name() const;
  /// Makes the device for a servo period; keeps references to script and clock.
  [[nodiscard]] std::unique_ptr<SimulatedPlant> make(const HandScript& script, const Clock& clock,
                                                     double period_s) const;
};
/// Finds both by name. An Error lists the names.
[[nodiscard]] Result<SimulatedRig> simulated_rig(const std::string& device, const std::string& hand);
/// The same with driver names: "sim" is the first arm, "sim:NAME" any.
[[nodiscard]] Result<SimulatedRig> simulated_rig_of_driver(const std::string& device,
                                                           const std::string& hand);

}  // namespace palpate::device
