// The ids by which haptic devices are known on USB, and the udev rules that let a user at the machine open
// them. One table for both, so that none is forgotten.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace palpate::device {

/// Through which node of the system a driver reaches the device.
enum class UsbNode : std::uint8_t { kUsb, kHidraw, kTty };

/// A device, or all of a maker's.
struct KnownUsb {
  const char* vendor;   ///< four hexadecimal digits, lower case
  const char* product;  ///< the same; empty: any of the vendor's
  UsbNode node;
  const char* name;
  const char* driver;  ///< what `palpate devices` calls the way to it
  bool generic;        ///< other gadgets carry these ids too: opened only when it is named
};

[[nodiscard]] std::span<const KnownUsb> known_usb();

/// The rule for one: MODE 0660, and access for who sits at the machine (uaccess). Not 0666.
[[nodiscard]] std::string udev_rule(const KnownUsb& device);
/// Of vendor and product as they were found, where the table knows only the vendor.
[[nodiscard]] std::string udev_rule(UsbNode node, const std::string& vendor, const std::string& product);
/// The file 70-palpate.rules, whole; device/drivers/70-palpate.rules is the same, for the installation.
[[nodiscard]] std::string udev_rules_file();

}  // namespace palpate::device
