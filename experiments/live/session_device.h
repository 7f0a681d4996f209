// Makes the device of every session: simulated with a hand, or a driver's. Includes the guard process, which
// releases the motors if the program dies.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/drivers.h>
#include <palpate/device/guard.h>
#include "device/servo/reconnecting_device.h"
#include "device/simulated/simulated_arm.h"

namespace palpate::experiments {

/// The arguments of --device and related options.
struct DeviceArguments {
  std::string device = "sim";        ///< sim, sim:NAME, or a driver's name
  std::string grip = "hand";         ///< the simulated hand's
  std::string file;                  ///< device description; empty: none
  std::vector<std::string> options;  ///< each KEY=VALUE
  double guard_kill_after_ms = 0.0;  ///< 0: never
};

/// Splits each KEY=VALUE. An Error names the invalid one.
[[nodiscard]] Result<std::vector<std::pair<std::string, std::string>>> option_pairs(
    const std::vector<std::string>& texts);

/// All drivers.
[[nodiscard]] const device::Drivers& session_drivers();

/// A requested device, checked without touching it.
struct DeviceChoice {
  std::optional<device::SimulatedRig> rig;  ///< empty: a driver makes the device
  const device::Driver* driver = nullptr;   ///< null for a rig
  device::DeviceRequest request;
  double guard_kill_after_s = 0.0;

  /// Name for recordings and reports before it is made.
  [[nodiscard]] std::string name() const;
  /// True for a device with motors, a person's hand and real time only.
  [[nodiscard]] bool is_real() const { return driver != nullptr && driver->transport != "simulation"; }
};
/// Refers to the drivers. Errors name the invalid argument.
[[nodiscard]] Result<DeviceChoice> choose_device(const DeviceArguments& arguments,
                                                 const device::Drivers& drivers);

/// A session's real or virtual clock. Create before its device.
class SessionClock {
 public:
  explicit SessionClock(bool accelerated) : accelerated_(accelerated) {}
  [[nodiscard]] const Clock& clock() const noexcept {
    return accelerated_ ? static_cast<const Clock&>(virtual_) : machine_;
  }
  [[nodiscard]] bool accelerated() const noexcept { return accelerated_; }
  [[nodiscard]] VirtualClock& virtual_clock() noexcept { return virtual_; }
  [[nodiscard]] const MonotonicClock& machine_clock() const noexcept { return machine_; }

 private:
  bool accelerated_;
  VirtualClock virtual_;
  MonotonicClock machine_;
};

/// For the session's thread only. Movable before use; refers to the clock.
class SessionDevice {
 public:
  /// Makes a driver's device and forks its guard; call before a scene is loaded and threads start. Opens
  /// nothing. Errors: the driver's; the guard did not start.
  [[nodiscard]] static Result<SessionDevice> make(const DeviceChoice& choice, const Clock& clock,
                                                  double period_s);
  /// Closes the device, then stops the guard.
  ~SessionDevice();
  SessionDevice(SessionDevice&&) noexcept = default;
  SessionDevice& operator=(SessionDevice&&) = delete;

  [[nodiscard]] bool is_simulated_hand() const noexcept { return choice_.rig.has_value(); }
  [[nodiscard]] const DeviceChoice& choice() const noexcept { return choice_; }
  /// Properties unproven on hardware, to be shown before any force.
  [[nodiscard]] const std::vector<std::string>& unproven() const noexcept { return unproven_; }
  /// Prints them on standard error.
  void report_unproven() const;
  /// The device's key-value facts: own filters, calibration, serial number. Call when it is open and no servo
  /// uses it.
  [[nodiscard]] std::vector<std::pair<std::string, std::string>> facts() const;
  /// Homing instruction without full stop; empty once homed. Any thread, once device() exists.
  [[nodiscard]] std::string homing_prompt() const;
  /// False: the force is shown on screen instead.
  [[nodiscard]] bool has_motors() const noexcept { return has_motors_; }
  [[nodiscard]] bool guarded() const noexcept { return guard_ != nullptr; }

  /// Opens a driver's device, whose limits are unknown before; a rig's are known.
  [[nodiscard]] Result<device::DeviceLimits> limits();
  /// Puts a simulated hand with this script on the rig. Call once, before device().
  void hold(device::HandScript script);
  /// Alternative without a scene: a simulated hand roams about the centre.
  void roam();

  [[nodiscard]] device::ReconnectingDevice& device() noexcept { return *device_; }
  /// The guard's heartbeat if there is a guard.
  [[nodiscard]] device::Heartbeat& heart() noexcept { return guard_ ? guard_->heartbeat() : *heart_; }

 private:
  SessionDevice() = default;

  DeviceChoice choice_;
  const Clock* clock_ = nullptr;
  double period_s_ = 0.0;
  // Order matters: members are destroyed in reverse, the device first and the guard last.
  std::unique_ptr<device::Guard> guard_;
  std::unique_ptr<device::Heartbeat> heart_;
  std::unique_ptr<device::HandScript> script_;
  std::unique_ptr<device::Device> inner_;
  std::unique_ptr<device::ReconnectingDevice> device_;
  std::vector<std::string> unproven_;
  std::function<std::vector<std::pair<std::string, std::string>>()> facts_;
  std::function<std::string(std::uint8_t)> homing_prompt_;
  bool has_motors_ = true;
};

// Tells the person at a device how to home it and when it is homed. Used by sessions, the bridge's far end
// and `palpate list devices --report`.

/// One thread, not the servo's. Refers to the device.
class HomingTeller {
 public:
  /// `then`: text after "the device knows its zero".
  HomingTeller(const SessionDevice& device, std::string then) : device_(device), then_(std::move(then)) {}
  /// A sentence not told yet; empty if nothing changed.
  [[nodiscard]] std::optional<std::string> news();

 private:
  const SessionDevice& device_;
  std::string then_, reported_;  // the present instruction
};

}  // namespace palpate::experiments
