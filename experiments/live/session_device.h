// The device of whatever uses one: a simulated one with a hand on it, or one that a driver makes, with the
// guard process that lets its motors go when the program dies. The one place where a device is made.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "device/interface/drivers.h"
#include "device/safety/guard.h"
#include "device/servo/replug_device.h"
#include "device/simulated/arm_models.h"
#include "toolkit/core/clock.h"

namespace palpate::experiments {

/// What --device and the options around it say.
struct DeviceArguments {
  std::string device = "sim";        ///< sim, sim:NAME, or a driver's
  std::string grip = "hand";         ///< of the simulated hand
  std::string file;                  ///< a device description; empty: none
  std::vector<std::string> options;  ///< each KEY=VALUE
  double guard_kill_after_ms = 0.0;  ///< 0: never
};

/// Of each KEY=VALUE. An Error names what is none.
[[nodiscard]] Result<std::vector<std::pair<std::string, std::string>>> option_pairs(
    const std::vector<std::string>& texts);

/// Every driver that there is.
[[nodiscard]] const device::Drivers& session_drivers();

/// A device that was asked for, checked as far as that goes without touching it.
struct DeviceChoice {
  std::optional<device::SimulatedRig> rig;  ///< nothing: a driver makes the device
  const device::Driver* driver = nullptr;   ///< null for a rig
  device::DeviceRequest request;
  double guard_kill_after_s = 0.0;

  /// As a recording and a report name it before it is made.
  [[nodiscard]] std::string name() const;
  /// It has motors and a hand, and time that cannot be made to pass.
  [[nodiscard]] bool is_real() const { return driver != nullptr && driver->transport != "simulation"; }
};
/// Errors name the argument that is wrong. The drivers are referred to.
[[nodiscard]] Result<DeviceChoice> choose_device(const DeviceArguments& arguments,
                                                 const device::Drivers& drivers);

/// The clock of a session, whichever it is. Made before its device.
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

/// One thread's, that of the session. Movable before it is used; refers to the clock.
class SessionDevice {
 public:
  /// Makes what a driver makes, and starts its guard: before a scene is loaded and threads are there, for the
  /// guard is forked. Opens nothing. Errors: of the driver; a guard that could not be started.
  [[nodiscard]] static Result<SessionDevice> make(const DeviceChoice& choice, const Clock& clock,
                                                  double period_s);
  /// Closes the device, then lets the guard go.
  ~SessionDevice();
  SessionDevice(SessionDevice&&) noexcept = default;
  SessionDevice& operator=(SessionDevice&&) = delete;

  [[nodiscard]] bool is_simulated_hand() const noexcept { return choice_.rig.has_value(); }
  [[nodiscard]] const DeviceChoice& choice() const noexcept { return choice_; }
  /// What no hardware has confirmed, for people, before there is any force.
  [[nodiscard]] const std::vector<std::string>& unproven() const noexcept { return unproven_; }
  /// The same on standard error.
  void say_unproven() const;
  /// What the device says of itself, key and value: filters of its own, calibration, serial number. Once it
  /// is open, and while no servo has it.
  [[nodiscard]] std::vector<std::pair<std::string, std::string>> facts() const;
  /// What a person has to do until the device knows its zero, a sentence without its full stop; empty: it
  /// does. Any thread, once device() is there.
  [[nodiscard]] std::string homing_prompt() const;
  /// False: what would be felt is shown instead.
  [[nodiscard]] bool has_motors() const noexcept { return has_motors_; }
  [[nodiscard]] bool guarded() const noexcept { return guard_ != nullptr; }

  /// Opens what a driver made, for its limits are known only then; a rig's are known.
  [[nodiscard]] Result<device::DeviceLimits> limits();
  /// A simulated hand takes the rig and goes along this script. To be called once, before device().
  void hold(device::HandScript script);
  /// Instead of that where there is no scene: a simulated hand roams about the middle.
  void roam();

  [[nodiscard]] device::ReplugDevice& device() noexcept { return *device_; }
  /// The guard's where there is one.
  [[nodiscard]] device::Heartbeat& heart() noexcept { return guard_ ? guard_->heartbeat() : *heart_; }

 private:
  SessionDevice() = default;

  DeviceChoice choice_;
  const Clock* clock_ = nullptr;
  double period_s_ = 0.0;
  // From here on in the order in which they go: the device last made goes first, the guard last of all.
  std::unique_ptr<device::Guard> guard_;
  std::unique_ptr<device::Heartbeat> heart_;
  std::unique_ptr<device::HandScript> script_;
  std::unique_ptr<device::Device> inner_;
  std::unique_ptr<device::ReplugDevice> device_;
  std::vector<std::string> unproven_;
  std::function<std::vector<std::pair<std::string, std::string>>()> facts_;
  std::function<std::string(std::uint8_t)> homing_prompt_;
  bool has_motors_ = true;
};

}  // namespace palpate::experiments
