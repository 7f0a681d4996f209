// What every simulated device with a hand on it has in common: where it truly is, and where the energy went.
#pragma once

#include "device/interface/device.h"
#include "device/simulated/hand_script.h"

namespace palpate::device {

/// The hand as a mass on a spring and a damper to its goal, and a steady push besides. All zero: nobody.
struct Hand {
  std::string name = "released";
  double mass_kg = 0.0;
  double damping_n_s_per_mm = 0.0;
  double stiffness_n_per_mm = 0.0;
  Vec3 push_n = Vec3::Zero();  ///< device frame
  /// The hand is stronger than any device: the device goes exactly where the goal goes. For the worst that a
  /// hand can do.
  bool guides = false;
};

/// Energy since the device was opened, mJ.
struct EnergyLedger {
  double motors = 0.0;    ///< what the motors put into the mechanism
  double damping = 0.0;   ///< what the device's own damping took
  double friction = 0.0;  ///< what its friction took
  double kinetic = 0.0;   ///< of the device alone, now
  /// What the hand has put in. Below 0 at the end of a cycle the device was active: it gave energy.
  [[nodiscard]] double hand() const noexcept { return kinetic + damping + friction - motors; }
};

class SimulatedPlant : public Device {
 public:
  /// The true position now, device frame: no encoder between.
  [[nodiscard]] virtual const Vec3& hip_mm() const noexcept = 0;
  /// The force that the motors show now.
  [[nodiscard]] virtual const Vec3& shown_n() const noexcept = 0;
  [[nodiscard]] virtual EnergyLedger energy() const noexcept = 0;
  /// At rest under a goal that rests for good: as long as what it shows and what it is sent stay the same to
  /// the bit, so does everything else about it. A device that cannot know says no.
  [[nodiscard]] virtual bool at_rest() const noexcept { return false; }
};

}  // namespace palpate::device
