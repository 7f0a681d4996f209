// Haply's 2DIY in the list of drivers.
#pragma once

#include "device/haply/planar_device.h"
#include "device/interface/drivers.h"

namespace palpate::device {

/// "planar". Options: path (needed: its board has the name of many), generation (2 or 3), force_n.
void register_planar_driver(Drivers& drivers);

}  // namespace palpate::device
