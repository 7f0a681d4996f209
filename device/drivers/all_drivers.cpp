#include "device/drivers/all_drivers.h"

#include "device/bridge/bridge_driver.h"
#include "device/haply/inverse3_driver.h"
#include "device/plugins/plugin_host.h"
#include "device/simulated/simulated_drivers.h"

namespace palpate::device {

void register_all_drivers(Drivers& drivers) {
  register_simulated_drivers(drivers);
  register_inverse3_driver(drivers);
  register_bridge_driver(drivers);
  register_plugin_drivers(drivers);
}

}  // namespace palpate::device
