// A thread that commands zero force when the servo stops. The servo's thread may hang, deadlock or die.
//
// First:
//   palpate::device::Heartbeat heart;
//   servo.watched_by(&heart);
//   palpate::device::Watchdog watchdog(device, heart);
//   if (auto started = watchdog.start(); !started) return failed(started.error());
#pragma once

#include <atomic>
#include <cstdint>
#include <thread>

#include <palpate/device/device.h>
#include <palpate/device/heartbeat.h>
#include <palpate/result.h>

namespace palpate::device {

struct WatchdogOptions {
  double limit_s = 0.010;  ///< without a heartbeat for longer: zero, and latched
  double every_s = 0.001;  ///< between two looks; below half the limit
};

/// Keeps references to device and heart, shares only atomics with the servo thread, and neither waits for the
/// other. While tripped it commands zero at every look, which overwrites a late frame; only Servo::rearm arms
/// the heart again.
class Watchdog {
 public:
  Watchdog(Device& device, Heartbeat& heart, const WatchdogOptions& options = {}) noexcept;
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;
  /// Ends the thread; commands zero if a beat was still expected.
  ~Watchdog() { stop(); }

  /// Starts the thread, above the servo's priority if allowed. An Error for invalid options.
  [[nodiscard]] Status start();
  void stop() noexcept;

  /// One look, at times that never go back: the thread's work, or a test's in virtual time. If the watchdog
  /// itself is late by over half the limit (the machine stood still), it commands zero at once but gives the
  /// servo one more limit before latching.
  void look(std::int64_t now_ns) noexcept;

  /// True with real-time priority.
  [[nodiscard]] bool real_time() const noexcept { return real_time_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t trips() const noexcept { return trips_.load(std::memory_order_relaxed); }
  /// Time of the last trip, on look()'s clock; the thread uses monotonic_ns().
  [[nodiscard]] std::int64_t tripped_ns() const noexcept {
    return tripped_ns_.load(std::memory_order_relaxed);
  }
  [[nodiscard]] std::uint64_t late_looks() const noexcept {
    return late_looks_.load(std::memory_order_relaxed);
  }

  static constexpr int kPriority = 85;  ///< between the servo's 80 and above the guard's 70

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
