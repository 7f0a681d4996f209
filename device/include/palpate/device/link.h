// Transports a device's bytes: USB, HID, serial, or simulated. The device above knows protocol and
// kinematics; the link knows neither.
//
// First:
//   std::array<std::uint8_t, 64> bytes;
//   const palpate::device::Polled came = link.poll(bytes);
//   if (came.gone) return;
//   for (std::size_t i = 0; i < came.size; ++i) take(bytes[i]);
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include <palpate/result.h>

namespace palpate::device {

/// Received bytes.
struct Polled {
  std::size_t size = 0;  ///< copied; 0: nothing yet
  bool gone = false;     ///< the other side is gone for good
};

/// A byte stream to and from one device. Between open and close poll belongs to one thread; any thread may
/// submit at any time, also after close, which is how a watchdog reaches the motors.
class Link {
 public:
  Link() = default;
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;
  virtual ~Link() = default;

  /// Opens the link. The call may take long and fail; its Error says what is missing.
  [[nodiscard]] virtual Status open() = 0;
  /// Safe at any time, and repeatedly.
  virtual void close() noexcept = 0;
  /// Sends one whole command. Never blocks or allocates. False: closed, gone, or no room.
  virtual bool submit(std::span<const std::uint8_t> bytes) noexcept = 0;
  /// Copies received bytes, at most into.size(); the rest waits. Packets may be split or merged. Never blocks
  /// or allocates.
  [[nodiscard]] virtual Polled poll(std::span<std::uint8_t> into) noexcept = 0;
};

/// A control request without data.
struct ControlRequest {
  std::uint8_t type = 0;  ///< bmRequestType
  std::uint8_t request = 0;
  std::uint16_t value = 0, index = 0;

  friend bool operator==(const ControlRequest&, const ControlRequest&) = default;
};

/// A link with control requests besides its stream (USB). poll() returns one bus packet per call, or parts of
/// it in successive calls, so packet starts are visible.
class ControlLink : public Link {
 public:
  /// Waits until the device has taken it: for set-up, not for frames. One thread.
  [[nodiscard]] virtual Status control(const ControlRequest& request) = 0;
};

}  // namespace palpate::device
