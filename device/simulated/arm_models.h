// Published parameters of known devices and hands; none is measured here. Each states its source and
// assumptions.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <palpate/device/drivers.h>
#include <palpate/result.h>
#include "device/simulated/simulated_arm.h"

namespace palpate::device {

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
