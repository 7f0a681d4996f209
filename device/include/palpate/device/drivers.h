// The registry of device drivers: each reports, without opening devices, what it finds and what is missing.
//
// First:
//   palpate::device::Drivers drivers;
//   palpate::device::register_all_drivers(drivers);
//   for (const auto& driver : drivers.all())
//     for (const auto& entry : driver.look()) std::puts(entry.what.c_str());
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/result.h>

namespace palpate::device {

enum class DeviceStatus : std::uint8_t {
  kReady,    ///< usable now
  kMissing,  ///< not connected, or what `needs` names is missing
  kRefused,  ///< connected, but this user may not open it
};
/// "ready", "missing", "refused".
[[nodiscard]] const char* device_status_name(DeviceStatus status) noexcept;

/// One present or possible device.
struct DeviceEntry {
  std::string name;  ///< as `--device` takes it
  std::string what;  ///< a phrase for the user
  DeviceStatus status = DeviceStatus::kMissing;
  std::vector<std::string> needs;  ///< steps before it can be used; empty if ready
};

/// A request to a driver.
struct DeviceRequest {
  std::string name;  ///< as `--device` takes it: "falcon", "arm:polhem-v3", "bridge:HOST:PORT"
  std::filesystem::path description;  ///< a device description file; empty: none
  /// `--device-option KEY=VALUE`, in order. Unknown keys are Errors.
  std::vector<std::pair<std::string, std::string>> options;
};

/// A device, not yet open.
struct MadeDevice {
  std::unique_ptr<Device> device;
  /// Commands zero force through its own handle, for a guard process (guard.h) made before the device opens;
  /// false: retry. Empty if no motors could hold a torque after the program's end.
  std::function<bool()> zero;
  std::vector<std::string> unproven;  ///< what no hardware has confirmed; shown before any force
  /// The open device's own information for reports: serial number, firmware, filters, calibration. Called by
  /// the owning thread. Empty: none.
  std::function<std::vector<std::pair<std::string, std::string>>()> facts{};
  /// Instruction to the user until the device is homed, for a DeviceState::homing_step: a sentence without
  /// full stop. Thread-safe. Empty: no words of its own.
  std::function<std::string(std::uint8_t homing_step)> homing_prompt{};
  bool has_motors = true;  ///< false: forces are shown on screen instead
};

struct Driver {
  std::string name;       ///< lower case, unique
  std::string transport;  ///< "simulation", "usb", "hid", "serial", "network", ..
  /// Looks for devices, without opening or changing anything, in some milliseconds. Returns at least one
  /// entry: if none is connected, what could be.
  std::function<std::vector<DeviceEntry>()> look;
  /// Makes the device of a request named like this driver, alone or followed by a colon; opens nothing. The
  /// device keeps a reference to the clock. Empty: the program makes it itself.
  std::function<Result<MadeDevice>(const DeviceRequest& request, const Clock& clock)> make;
};

/// In order of registration. Not thread-safe.
class Drivers {
 public:
  /// An empty or taken name, or a missing look, is a programming error (asserted).
  void add(Driver driver);
  [[nodiscard]] const std::vector<Driver>& all() const noexcept { return drivers_; }
  /// The driver of a device's name, or nullptr.
  [[nodiscard]] const Driver* of(const std::string& device_name) const noexcept;

 private:
  std::vector<Driver> drivers_;
};

/// "sim": all known arms and the admittance device; always ready.
void register_simulated_drivers(Drivers& drivers);
/// All drivers, simulated ones first. Call once per Drivers. Only in builds with PALPATE_WITH_DEVICES.
void register_all_drivers(Drivers& drivers);

}  // namespace palpate::device
