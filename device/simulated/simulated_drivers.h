// The simulated devices as entries of the list of drivers.
#pragma once

#include "device/interface/drivers.h"

namespace palpate::device {

/// "sim": every arm of arm_models.h and the admittance device; always ready.
void register_simulated_drivers(Drivers& drivers);

}  // namespace palpate::device
