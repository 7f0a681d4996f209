// Every driver that this build has.
#pragma once

#include "device/interface/drivers.h"

namespace palpate::device {

/// Simulated ones first, then those with hardware. To be called once for each Drivers.
void register_all_drivers(Drivers& drivers);

}  // namespace palpate::device
