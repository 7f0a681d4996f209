#include "device/drivers/known_usb.h"

#include <array>
#include <cstdint>

namespace palpate::device {
namespace {

constexpr const char* kSpacemouse = "3Dconnexion";

constexpr std::array kKnown = {
    KnownUsb{"0403", "cb48", UsbNode::kUsb, "Novint Falcon", "falcon", false},
    KnownUsb{"1451", "", UsbNode::kUsb, "Force Dimension", "dhd", false},
    KnownUsb{"2988", "", UsbNode::kHidraw, "3D Systems Touch", "openhaptics", false},
    KnownUsb{"1234", "0006", UsbNode::kHidraw, "WoodenHaptics (mbed)", "arm", true},
    KnownUsb{"16c0", "0486", UsbNode::kHidraw, "Polhem, WoodenHaptics (Teensy RawHID)", "arm", true},
    KnownUsb{"16c0", "0483", UsbNode::kTty, "Polhem (Teensy serial)", "arm", true},
    // Product by product: the maker's keyboards and mice must stay closed to everybody but their own driver.
    KnownUsb{"256f", "c62e", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"256f", "c62f", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"256f", "c631", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"256f", "c632", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"256f", "c633", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"256f", "c635", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"256f", "c636", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"256f", "c638", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"256f", "c63a", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"256f", "c641", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"256f", "c652", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    // The older ones carry Logitech's vendor id.
    KnownUsb{"046d", "c603", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"046d", "c605", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"046d", "c606", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"046d", "c621", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"046d", "c623", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"046d", "c625", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"046d", "c626", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"046d", "c627", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"046d", "c628", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"046d", "c629", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"046d", "c62b", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
    KnownUsb{"046d", "c640", UsbNode::kHidraw, kSpacemouse, "spacemouse", false},
};

constexpr const char* kHead =
    "# Haptic devices: who sits at the machine may open them (uaccess); nobody else but root and its group.\n"
    "# Installed by Palpate as lib/udev/rules.d/70-palpate.rules. By hand: copy it to /etc/udev/rules.d, "
    "then\n"
    "#   sudo udevadm control --reload && sudo udevadm trigger\n"
    "# and plug the device in again.\n";

}  // namespace

std::span<const KnownUsb> known_usb() {
  return kKnown;
}

std::string udev_rule(UsbNode node, const std::string& vendor, const std::string& product) {
  // A node of its own (hidraw, tty) has the ids at its parent: ATTRS looks there.
  const bool own = node != UsbNode::kUsb;
  const std::string attribute = own ? "ATTRS" : "ATTR";
  std::string rule = node == UsbNode::kUsb      ? R"(SUBSYSTEM=="usb")"
                     : node == UsbNode::kHidraw ? R"(KERNEL=="hidraw*", SUBSYSTEM=="hidraw")"
                                                : R"(KERNEL=="ttyACM*", SUBSYSTEM=="tty")";
  rule += ", " + attribute + R"({idVendor}==")" + vendor + '"';
  if (!product.empty()) rule += ", " + attribute + R"({idProduct}==")" + product + '"';
  return rule + R"(, MODE="0660", TAG+="uaccess")";
}

std::string udev_rule(const KnownUsb& device) {
  return udev_rule(device.node, device.vendor, device.product);
}

std::string udev_rules_file() {
  std::string text = kHead;
  const char* group = "";
  for (const KnownUsb& device : kKnown) {
    if (std::string(group) != device.name) text += std::string("\n# ") + device.name + "\n";
    group = device.name;
    text += udev_rule(device) + "\n";
  }
  return text;
}

}  // namespace palpate::device
