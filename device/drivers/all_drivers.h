// USB ids and udev rules of haptic devices. The rules let a local user open them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace palpate::device {

/// The system node through which a driver reaches the device.
enum class UsbNode : std::uint8_t { kUsb, kHidraw, kTty };

/// One device, or all of a vendor's.
struct UsbId {
  std::string vendor;   ///< four hexadecimal digits, lower case
  std::string product;  ///< likewise; empty: any product
  UsbNode node;
  std::string name;
  std::string driver;  ///< driver name in `palpate list devices`
};

[[nodiscard]] const std::vector<UsbId>& known_usb_ids();

/// The udev rule of one entry: MODE 0660 and access for the local user (uaccess). The mode is never 0666.
[[nodiscard]] std::string udev_rule(const UsbId& device);
/// The same for a found vendor and product, where the table has only the vendor.
[[nodiscard]] std::string udev_rule(UsbNode node, const std::string& vendor, const std::string& product);

}  // namespace palpate::device
