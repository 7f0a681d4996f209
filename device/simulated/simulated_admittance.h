// An admittance device without hardware: it measures the hand's force and moves as a virtual mass with a
// virtual damper would under that force and the renderer's (force in, motion out; section 2.2.4 of the
// thesis, table 5). Behind the same interface as the impedance devices: a position out, a governed force in.
#pragma once

#include "device/simulated/motion.h"
#include "device/simulated/simulated_plant.h"
#include "toolkit/core/clock.h"

namespace palpate::device {

/// The defaults are those of a robot of the class of the HapticMaster (van der Linde and others 2002): heavy,
/// strong, stiff. Virtual mass 2 kg, 100 N; drive bandwidth and virtual damping assumed.
struct AdmittanceOptions {
  std::string name = "admittance";
  double mass_kg = 2.0;               ///< that the hand feels in free space
  double damping_n_s_per_mm = 0.005;  ///< the same
  double bandwidth_hz = 50.0;         ///< of the position drives, critically damped; 0: they follow at once
  double force_max_n = 100.0;         ///< of the renderer's force
  double speed_max_mm_s = 1000.0;
  double period_s = 1e-3;
  double workspace_mm = 200.0;
};

/// In each frame, semi-implicit: v += T (hand + renderer - B v) / M, and the virtual mass moves on with v.
/// Its place is what read() answers: the renderer and the mass meet in the controller, without encoder and
/// drives between them. The drives follow it, and the hand is on the drives. The hand is a spring and a
/// damper to its goal; its mass hangs behind them and is not measured.
class SimulatedAdmittance final : public SimulatedPlant {
 public:
  SimulatedAdmittance(const AdmittanceOptions& options, const Hand& hand, const HandScript& script,
                      const Clock& clock)
      : options_(options), hand_(hand), script_(script), clock_(clock) {}

  [[nodiscard]] std::string name() const override { return "sim:" + options_.name; }
  [[nodiscard]] Status open() override;
  void close() noexcept override { open_ = false; }
  [[nodiscard]] DeviceLimits limits() const noexcept override;
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce force) noexcept override;

  [[nodiscard]] const Vec3& hip_mm() const noexcept override { return motion_.x_mm; }
  /// What the hand feels: against its own force.
  [[nodiscard]] const Vec3& shown_n() const noexcept override { return shown_n_; }
  [[nodiscard]] EnergyLedger energy() const noexcept override { return ledger_; }

 private:
  [[nodiscard]] Vec3 hand_n(double t_s) const noexcept;
  void advance_to(double t_s) noexcept;

  AdmittanceOptions options_;
  Hand hand_;
  const HandScript& script_;
  const Clock& clock_;
  bool open_ = false;
  double opened_s_ = 0.0, now_s_ = 0.0, last_read_s_ = -1.0, last_sent_s_ = 0.0;
  Motion motion_;
  Vec3 goal_mm_ = Vec3::Zero(), goal_mm_s_ = Vec3::Zero();  // of the drives
  Vec3 shown_n_ = Vec3::Zero();
  EnergyLedger ledger_;
};

}  // namespace palpate::device
