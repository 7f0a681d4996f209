// 3Dconnexion devices in the list of drivers.
#pragma once

#include "device/interface/drivers.h"
#include "device/spacemouse/spacemouse_device.h"

namespace palpate::device {

/// "spacemouse". Options: path, serial, v_max_mm_per_s, dead_zone, curve, half_extent_mm, force_max_n.
void register_spacemouse_driver(Drivers& drivers);

}  // namespace palpate::device
