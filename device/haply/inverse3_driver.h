// The Inverse3 among the drivers.
#pragma once

#include "device/interface/drivers.h"

namespace palpate::device {

/// "inverse3" or "inverse3:DEVICE_ID". Options: service=HOST:PORT, force-gate=0..1, torque-scaling=on|off,
/// centre-mm=X/Y/Z, force-max-n.
void register_inverse3_driver(Drivers& drivers);

}  // namespace palpate::device
