#include "device/drivers/all_drivers.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include <palpate/device/drivers.h>
#include "device/arms/arm_device.h"
#include "device/bridge/bridge_device.h"
#include "device/falcon/falcon_device.h"
#include "device/haply/inverse3_device.h"
#include "device/haply/planar_device.h"
#include "device/plugins/plugin_host.h"
#include "device/simulated/simulated_arm.h"
#include "device/spacemouse/spacemouse_device.h"

namespace palpate::device {
namespace {

const std::array kForceDevices = {
    UsbId{"0403", "cb48", UsbNode::kUsb, "Novint Falcon", "falcon"},
    UsbId{"1451", "", UsbNode::kUsb, "Force Dimension", "dhd"},
    UsbId{"2988", "", UsbNode::kHidraw, "3D Systems Touch", "openhaptics"},
    UsbId{"1234", "0006", UsbNode::kHidraw, "WoodenHaptics (mbed)", "arm"},
    UsbId{"16c0", "0486", UsbNode::kHidraw, "Polhem, WoodenHaptics (Teensy RawHID)", "arm"},
    UsbId{"16c0", "0483", UsbNode::kTty, "Polhem (Teensy serial)", "arm"}};

/// The 3Dconnexion devices as single products, because the makers' keyboards and mice must stay closed to
/// other programs; those with Logitech's id last.
std::vector<UsbId> all_usb_ids() {
  std::vector<UsbId> all(kForceDevices.begin(), kForceDevices.end());
  for (const SpaceMouseModel& model : spacemouse_models())
    all.push_back({fmt::format("{:04x}", model.vendor), fmt::format("{:04x}", model.product),
                   UsbNode::kHidraw, "3Dconnexion", "spacemouse"});
  std::stable_partition(all.begin(), all.end(), [](const UsbId& one) { return one.vendor != "046d"; });
  return all;
}

}  // namespace

const std::vector<UsbId>& known_usb_ids() {
  static const std::vector<UsbId> kKnown = all_usb_ids();
  return kKnown;
}

std::string udev_rule(UsbNode node, const std::string& vendor, const std::string& product) {
  // For hidraw and tty nodes the ids are at the parent: ATTRS matches there.
  const bool own = node != UsbNode::kUsb;
  const std::string attribute = own ? "ATTRS" : "ATTR";
  std::string rule = node == UsbNode::kUsb      ? R"(SUBSYSTEM=="usb")"
                     : node == UsbNode::kHidraw ? R"(KERNEL=="hidraw*", SUBSYSTEM=="hidraw")"
                                                : R"(KERNEL=="ttyACM*", SUBSYSTEM=="tty")";
  rule += ", " + attribute + R"({idVendor}==")" + vendor + '"';
  if (!product.empty()) rule += ", " + attribute + R"({idProduct}==")" + product + '"';
  return rule + R"(, MODE="0660", TAG+="uaccess")";
}

std::string udev_rule(const UsbId& device) {
  return udev_rule(device.node, device.vendor, device.product);
}

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
