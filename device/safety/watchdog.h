// A thread of its own that commands zero force when the servo thread does not come back: a renderer stuck in
// a loop, a lock that is never given, a thread that died.
#pragma once

#include <atomic>
#include <cstdint>
#include <thread>

#include "device/interface/device.h"
#include "device/safety/heartbeat.h"
#include "toolkit/core/result.h"

namespace palpate::device {

struct WatchdogOptions {
  double limit_s = 0.010;  ///< no heartbeat for longer: zero, and latched
  double every_s = 0.001;  ///< between two looks; below half of the limit
};

/// Keeps references to device and heart. It shares nothing with the servo thread but atomics: neither waits
/// for the other. While it is tripped it commands zero at every look, so that a frame that was about to send
/// is overwritten; the heart is armed again by the servo, by hand (Servo::rearm).
class Watchdog {
 public:
  Watchdog(Device& device, Heartbeat& heart, const WatchdogOptions& options = {}) noexcept;
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;
  /// Ends the thread, and commands zero where a beat was still expected.
  ~Watchdog() { stop(); }

  /// The thread, above the servo's priority where that is allowed. An Error for options that are not right.
  [[nodiscard]] Status start();
  void stop() noexcept;

  /// One look, at a time that never goes back: what the thread does. For virtual time, by one thread. A
  /// watchdog that itself comes late by over half of the limit (the whole machine stood still) commands zero
  /// at once, but gives the servo one more limit before it latches.
  void look(std::int64_t now_ns) noexcept;

  /// Whether the thread obtained a real-time priority.
  [[nodiscard]] bool real_time() const noexcept { return real_time_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t trips() const noexcept { return trips_.load(std::memory_order_relaxed); }
  /// When it did so last, on the clock of look(); the thread's is monotonic_ns().
  [[nodiscard]] std::int64_t tripped_ns() const noexcept {
    return tripped_ns_.load(std::memory_order_relaxed);
  }
  [[nodiscard]] std::uint64_t late_looks() const noexcept {
    return late_looks_.load(std::memory_order_relaxed);
  }

  static constexpr int kPriority = 85;  ///< the servo has 80, the guard process 70

 private:
  void run() noexcept;

  Device& device_;
  Heartbeat& heart_;
  WatchdogOptions options_;
  std::int64_t limit_ns_, every_ns_;
  StallDetector detector_;
  std::int64_t last_look_ns_ = -1;
  std::uint64_t last_count_ = 0;
  std::atomic<bool> ending_{false}, real_time_{false};
  std::atomic<std::uint64_t> trips_{0}, late_looks_{0};
  std::atomic<std::int64_t> tripped_ns_{0};
  std::thread thread_;
};

}  // namespace palpate::device
