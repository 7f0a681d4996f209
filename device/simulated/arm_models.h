// Numbers of known devices and hands, for simulations. Not measured here: each says where it is from, and
// which of them are assumed.
#pragma once

#include <string>
#include <vector>

#include "device/simulated/simulated_admittance.h"
#include "device/simulated/simulated_arm.h"

namespace palpate::device {

/// "omni", "touch", "falcon", "omega3"; nothing for another name.
[[nodiscard]] const std::vector<ArmOptions>& arm_models();
/// "released", "hand", "finger", "arm".
[[nodiscard]] const std::vector<Hand>& hand_models();
/// The name of the one admittance device.
[[nodiscard]] const AdmittanceOptions& admittance_model();

}  // namespace palpate::device
