// Around a device that may be unplugged and come back while a servo runs. The servo keeps ticking with no
// force; another thread opens the device again, since that may take seconds; then the servo has it back.
// Nothing is armed by this: force comes back with an explicit re-arm and its soft start alone.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>

#include "device/interface/device.h"

namespace palpate::device {

/// Refers to the device. Who owns it:
///
///   closed --open()--> servo --it is gone, and zero was sent--> lost --reopen()--> other --opened--> servo
///
/// read, send and close belong to the servo's thread as of any device, reopen to one other thread, the rest
/// to any. A device that comes back with other limits is another device: it is refused, for the governor was
/// made for the first.
class ReplugDevice final : public Device {
 public:
  explicit ReplugDevice(Device& inner) noexcept : inner_(inner) {}
  ~ReplugDevice() override { ReplugDevice::close(); }

  [[nodiscard]] std::string name() const override { return inner_.name(); }
  /// Open already, and not read or closed since, it stays open: who must know its limits before a servo
  /// starts opens it first.
  [[nodiscard]] Status open() override;
  /// While another thread opens it again, that thread closes it once it is done.
  void close() noexcept override;
  /// Of the first opening.
  [[nodiscard]] DeviceLimits limits() const noexcept override { return limits_; }
  /// kLost from the moment on in which it is gone.
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce force) noexcept override;
  /// False too while it is being opened again: that commands zero itself.
  bool cut_force() noexcept override;

  /// It is gone: reopen() may be tried. Any thread.
  [[nodiscard]] bool lost() const noexcept { return owner_.load(std::memory_order_acquire) == Owner::kLost; }
  /// The servo has it. Any thread.
  [[nodiscard]] bool here() const noexcept { return owner_.load(std::memory_order_acquire) == Owner::kServo; }
  /// Closes what is left of it and opens it. May take as long as the device's open. Done where there was
  /// nothing to do; an Error says what is still missing: try again later.
  [[nodiscard]] Status reopen();
  /// DeviceState::homing_step of the newest state that was not homed; nothing: it knows its zero, or nobody
  /// has read it yet. Any thread.
  [[nodiscard]] std::optional<std::uint8_t> homing() const noexcept {
    const int step = homing_.load(std::memory_order_acquire);
    return step == kHomed ? std::nullopt : std::optional(static_cast<std::uint8_t>(step));
  }
  /// How often it came back. Any thread.
  [[nodiscard]] std::uint64_t times_back() const noexcept {
    return times_back_.load(std::memory_order_relaxed);
  }

 private:
  enum class Owner : std::uint8_t { kNobody, kServo, kLost, kOther };
  static constexpr int kHomed = -1;  // no step
  void close_from(Owner from) noexcept;

  Device& inner_;
  DeviceLimits limits_;
  std::atomic<Owner> owner_{Owner::kNobody};
  std::atomic<bool> ended_{false};  // close() was called: whoever has it closes it
  std::atomic<int> cutting_{0};     // threads within cut_force
  std::atomic<std::uint64_t> times_back_{0};
  std::atomic<int> homing_{kHomed};
  bool unread_ = false;  // open, and nobody has read
  bool gone_ = false;    // the servo's: lost with this tick
};

}  // namespace palpate::device
