// Numbers of known devices and hands, for simulations. Not measured here: each says where it is from, and
// which of them are assumed.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "device/simulated/simulated_admittance.h"
#include "device/simulated/simulated_arm.h"
#include "toolkit/core/result.h"

namespace palpate::device {

/// "omni", "touch", "falcon", "omega3"; nothing for another name.
[[nodiscard]] const std::vector<ArmOptions>& arm_models();
/// "released", "hand", "finger", "arm".
[[nodiscard]] const std::vector<Hand>& hand_models();
/// The name of the one admittance device.
[[nodiscard]] const AdmittanceOptions& admittance_model();

/// One of these devices with one of these hands on it.
struct SimulatedRig {
  std::optional<ArmOptions> arm;  ///< nothing: the admittance device
  Hand hand;

  [[nodiscard]] std::string device_name() const;
  /// Run at `period_s`; refers to script and clock.
  [[nodiscard]] std::unique_ptr<SimulatedPlant> make(const HandScript& script, const Clock& clock,
                                                     double period_s) const;
};
/// By their names. An Error lists those that there are.
[[nodiscard]] Result<SimulatedRig> simulated_rig(const std::string& device, const std::string& hand);
/// The same among devices of other drivers: "sim" for the first arm, "sim:NAME" for any.
[[nodiscard]] Result<SimulatedRig> simulated_rig_of_driver(const std::string& device,
                                                           const std::string& hand);

}  // namespace palpate::device
