// What a program knows of devices without opening one: every driver registers itself, and says when asked
// what it finds and what it still needs.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "device/interface/device.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/result.h"

namespace palpate::device {

enum class DeviceStatus : std::uint8_t {
  kReady,    ///< can be used now
  kMissing,  ///< could be used if it were connected, or if what `needs` names were there
  kRefused,  ///< connected, and this user may not open it
};
/// "ready", "missing", "refused".
[[nodiscard]] const char* device_status_name(DeviceStatus status) noexcept;

/// One device that is there, or could be.
struct DeviceEntry {
  std::string name;  ///< as `--device` takes it
  std::string what;  ///< a sentence's part for people
  DeviceStatus status = DeviceStatus::kMissing;
  std::vector<std::string> needs;  ///< what is to be done before it can be used; empty where it is ready
};

/// What a driver is asked to make.
struct DeviceRequest {
  std::string name;  ///< as `--device` takes it: "falcon", "arm:polhem-v3", "bridge:HOST:PORT"
  std::filesystem::path description;  ///< a device description file; empty: none
  /// `--device-option KEY=VALUE`, in the order given. A key that the driver does not know is an error.
  std::vector<std::pair<std::string, std::string>> options;
};

/// A device, not yet open.
struct MadeDevice {
  std::unique_ptr<Device> device;
  /// For a guard process (safety/guard.h), made before the device is opened: takes a handle of its own and
  /// commands zero force; false: not yet, try again. Empty where the device has no motors that could hold a
  /// torque after the program's end.
  std::function<bool()> zero;
  std::vector<std::string> unproven;  ///< what no hardware has confirmed, for people, before force is shown
  /// What the device says of itself once it is open: serial number, firmware, filters of its own,
  /// calibration. For reports; called by the thread that owns the device. Empty: nothing.
  std::function<std::vector<std::pair<std::string, std::string>>()> facts{};
  /// What a person has to do until the device knows its zero, for a DeviceState::homing_step that it showed:
  /// a sentence without its full stop. Any thread. Empty: the driver has no words of its own.
  std::function<std::string(std::uint8_t homing_step)> homing_prompt{};
  bool has_motors = true;  ///< false: what would be felt is shown to people instead
};

struct Driver {
  std::string name;       ///< lower case, unique
  std::string transport;  ///< "simulation", "usb", "hid", "serial", "network", ..
  /// Looks for devices now. Opens none, changes nothing, may take some milliseconds. At least one entry:
  /// where nothing is connected, what could be.
  std::function<std::vector<DeviceEntry>()> look;
  /// Makes the device of a request whose name is this driver's name, or begins with it and a colon; opens
  /// nothing. The device keeps a reference to the clock. Empty: the program makes it in a way of its own.
  std::function<Result<MadeDevice>(const DeviceRequest& request, const Clock& clock)> make;
};

/// In the order of registration. Not thread-safe.
class Drivers {
 public:
  /// A name taken or empty, or no look, is an assertion: only code registers.
  void add(Driver driver);
  [[nodiscard]] const std::vector<Driver>& all() const noexcept { return drivers_; }
  /// The driver of a device's name; nullptr: none has it.
  [[nodiscard]] const Driver* of(const std::string& device_name) const noexcept;

 private:
  std::vector<Driver> drivers_;
};

}  // namespace palpate::device
