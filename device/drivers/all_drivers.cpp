#include <palpate/device/drivers.h>

#include "device/arms/arm_device.h"
#include "device/bridge/bridge_device.h"
#include "device/falcon/falcon_device.h"
#include "device/haply/inverse3_device.h"
#include "device/haply/planar_device.h"
#include "device/plugins/plugin_host.h"
#include "device/simulated/arm_models.h"
#include "device/spacemouse/spacemouse_device.h"

namespace palpate::device {

void register_all_drivers(Drivers& drivers) {
  register_simulated_drivers(drivers);
  register_falcon_driver(drivers);
  register_arm_driver(drivers);
  register_planar_driver(drivers);
  register_spacemouse_driver(drivers);
  register_inverse3_driver(drivers);
  register_bridge_driver(drivers);
  register_plugin_drivers(drivers);
}

}  // namespace palpate::device
