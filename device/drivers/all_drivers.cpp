#include "device/drivers/all_drivers.h"

#include "device/arms/arm_driver.h"
#include "device/bridge/bridge_driver.h"
#include "device/falcon/falcon_driver.h"
#include "device/haply/inverse3_driver.h"
#include "device/haply/planar_driver.h"
#include "device/plugins/plugin_host.h"
#include "device/simulated/simulated_drivers.h"
#include "device/spacemouse/spacemouse_driver.h"

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
