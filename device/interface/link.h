// What carries a device's bytes: USB, HID, a serial line, or a simulation of one. A device above it knows the
// protocol and the kinematics; a link knows neither.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "toolkit/core/result.h"

namespace palpate::device {

/// Bytes that came.
struct Polled {
  std::size_t size = 0;  ///< copied; 0: nothing yet
  bool gone = false;     ///< the other side is gone for good
};

/// A stream of bytes to and from one device. Between open and close poll belongs to one thread; submit may be
/// called by any thread at any time, also after close, for that is how a watchdog reaches the motors.
class Link {
 public:
  Link() = default;
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;
  virtual ~Link() = default;

  /// May take long and fail; says what is missing.
  [[nodiscard]] virtual Status open() = 0;
  /// Safe at any time, twice too.
  virtual void close() noexcept = 0;
  /// Hands over one whole command. Never blocks, never allocates. False: closed, gone, or no room now.
  virtual bool submit(std::span<const std::uint8_t> bytes) noexcept = 0;
  /// Copies what has come, at most into.size() bytes; the rest waits. Packets may be torn and glued. Never
  /// blocks, never allocates.
  [[nodiscard]] virtual Polled poll(std::span<std::uint8_t> into) noexcept = 0;
};

}  // namespace palpate::device
