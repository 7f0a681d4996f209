// Every driver, and the udev rules.
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <set>

#include <palpate/device/drivers.h>
#include "device/drivers/usb_ids.h"
#include "tests/device/helpers.h"

namespace palpate::device {
namespace {

TEST(AllDrivers, HaveNamesOfTheirOwnAndSayWhatTheyNeed) {
  Drivers drivers;
  register_all_drivers(drivers);
  std::set<std::string> entries;
  for (const Driver& driver : drivers.all()) {
    EXPECT_FALSE(driver.transport.empty()) << driver.name;
    const std::vector<DeviceEntry> found = driver.look();
    EXPECT_FALSE(found.empty()) << driver.name;
    for (const DeviceEntry& entry : found) {
      EXPECT_EQ(drivers.of(entry.name), &driver) << entry.name;
      EXPECT_TRUE(entries.insert(entry.name).second) << entry.name;
      EXPECT_EQ(entry.status == DeviceStatus::kReady, entry.needs.empty()) << entry.name;
    }
  }
  for (const char* name : {"sim", "bridge", "inverse3", "dhd", "openhaptics"})
    EXPECT_NE(drivers.of(name), nullptr) << name;
}

// Whoever is sent a device's name and nothing else learns what it is called, never a crash.
TEST(AllDrivers, NonsenseIsRefusedByEachWithAnError) {
  Drivers drivers;
  register_all_drivers(drivers);
  const MonotonicClock clock;
  for (const Driver& driver : drivers.all()) {
    if (!driver.make) continue;
    const Result<MadeDevice> made = driver.make({driver.name, {}, {{"no-such-option", "1"}}}, clock);
    ASSERT_FALSE(made) << driver.name;
    EXPECT_FALSE(made.error().what.empty());
  }
}

TEST(UdevRules, TheInstalledFileIsThatOfTheTable) {
  std::ifstream in(PALPATE_SOURCE_ROOT "/device/drivers/70-palpate.rules");
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  EXPECT_EQ(text, udev_rules_file()) << udev_rules_file();
}

TEST(UdevRules, GiveAccessToWhoSitsThereAndToNobodyElse) {
  for (const UsbId& device : known_usb_ids()) {
    const std::string rule = udev_rule(device);
    EXPECT_TRUE(says(rule, "MODE=\"0660\", TAG+=\"uaccess\""));
    EXPECT_TRUE(says(rule, device.vendor));
    EXPECT_FALSE(says(rule, "0666"));
    EXPECT_EQ(std::string(device.vendor).size(), 4u);
  }
  EXPECT_EQ(
      udev_rule(UsbNode::kUsb, "0403", "cb48"),
      R"(SUBSYSTEM=="usb", ATTR{idVendor}=="0403", ATTR{idProduct}=="cb48", MODE="0660", TAG+="uaccess")");
  EXPECT_EQ(
      udev_rule(UsbNode::kHidraw, "256f", ""),
      R"(KERNEL=="hidraw*", SUBSYSTEM=="hidraw", ATTRS{idVendor}=="256f", MODE="0660", TAG+="uaccess")");
}

// Keyboards and mice of the same vendors must stay closed to everybody but their own driver.
TEST(UdevRules, OpenNoKeyboard) {
  const std::set<std::string> shared = {"046d", "256f"};
  const std::set<std::string> others = {"c650", "c651", "c654", "c655", "c656",
                                        "c657", "c658", "c664", "c665", "c668"};
  for (const UsbId& device : known_usb_ids()) {
    EXPECT_TRUE(shared.count(device.vendor) == 0 || device.product[0] != '\0') << device.vendor;
    EXPECT_EQ(others.count(device.product), 0u) << device.product;
  }
}

}  // namespace
}  // namespace palpate::device
