// What a program knows of devices without opening one: every driver registers itself, and says when asked
// what it finds and what it still needs.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

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

struct Driver {
  std::string name;       ///< lower case, unique
  std::string transport;  ///< "simulation", "usb", "hid", "serial", "network", ..
  /// Looks for devices now. Opens none, changes nothing, may take some milliseconds. At least one entry:
  /// where nothing is connected, what could be.
  std::function<std::vector<DeviceEntry>()> look;
};

/// In the order of registration. Not thread-safe.
class Drivers {
 public:
  /// A name taken or empty, or no look, is an assertion: only code registers.
  void add(Driver driver);
  [[nodiscard]] const std::vector<Driver>& all() const noexcept { return drivers_; }

 private:
  std::vector<Driver> drivers_;
};

}  // namespace palpate::device
