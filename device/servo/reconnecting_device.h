// Wraps a device that may be unplugged and return. The servo keeps ticking without force while another thread
// reopens the device, which may take seconds. It arms nothing: force returns only with an explicit re-arm and
// its soft start.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>

#include <palpate/device/device.h>

namespace palpate::device {

/// Refers to the device. Ownership:
///  closed --open()--> servo --gone, zero was sent--> lost --reopen()--> other --opened--> servo
/// read, send and close belong to the servo's thread, reopen to one other thread, the rest to any. A device
/// that returns with other limits is refused, because the governor was made for the first.
class ReconnectingDevice final : public Device {
 public:
  explicit ReconnectingDevice(Device& inner) noexcept : inner_(inner) {}
  ~ReconnectingDevice() override { ReconnectingDevice::close(); }

  [[nodiscard]] std::string name() const override { return inner_.name(); }
  /// Keeps an already open, unread device open: callers that need limits before the servo starts open it
  /// first.
  [[nodiscard]] Status open() override;
  /// While another thread reopens it, that thread closes it afterwards.
  void close() noexcept override;
  /// Of the first opening.
  [[nodiscard]] DeviceLimits limits() const noexcept override { return limits_; }
  /// kLost from the moment it is gone.
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce force) noexcept override;
  /// Also false during reopening, which commands zero itself.
  bool cut_force() noexcept override;

  /// Gone: reopen() may be tried. Any thread.
  [[nodiscard]] bool lost() const noexcept { return owner_.load(std::memory_order_acquire) == Owner::kLost; }
  /// The servo owns it. Any thread.
  [[nodiscard]] bool here() const noexcept { return owner_.load(std::memory_order_acquire) == Owner::kServo; }
  /// Closes the rest and opens it; may take as long as open(). No-op if not lost; an Error says what is
  /// missing: retry later.
  [[nodiscard]] Status reopen();
  /// DeviceState::homing_step of the newest unhomed state; nothing if homed or unread. Any thread.
  [[nodiscard]] std::optional<std::uint8_t> homing() const noexcept {
    const int step = homing_.load(std::memory_order_acquire);
    return step == kHomed ? std::nullopt : std::optional(static_cast<std::uint8_t>(step));
  }
  /// Number of returns. Any thread.
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
  std::atomic<bool> ended_{false};  // close() was called: the owner closes it
  std::atomic<int> cutting_{0};     // threads in cut_force
  std::atomic<std::uint64_t> times_back_{0};
  std::atomic<int> homing_{kHomed};
  bool unread_ = false;  // open and unread
  bool gone_ = false;    // servo's: lost in this tick
};

}  // namespace palpate::device
