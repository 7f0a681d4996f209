// The servo's sign of life, and its stop signal.
//
// First:
//   palpate::device::Heartbeat heart;
//   servo.watched_by(&heart);
//   palpate::device::Watchdog watchdog(device, heart);
#pragma once

#include <atomic>
#include <cstdint>

namespace palpate::device {

/// Beaten once a frame by the servo thread; read by any thread, and by other processes in shared memory. Uses
/// lock-free atomics only, so a process may be killed at any instruction. Every call is wait-free.
class Heartbeat {
 public:
  /// Beats; from here on the next beat is expected.
  void beat() noexcept {
    count_.store(count_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    expected_.store(true, std::memory_order_release);
  }
  /// Expects no beat until the next: for long work without force.
  void rest() noexcept { expected_.store(false, std::memory_order_release); }

  [[nodiscard]] std::uint64_t count() const noexcept { return count_.load(std::memory_order_relaxed); }
  [[nodiscard]] bool expected() const noexcept { return expected_.load(std::memory_order_acquire); }

  /// Trips: the loop sends zero until it is armed again.
  void trip() noexcept { tripped_.store(true, std::memory_order_release); }
  [[nodiscard]] bool tripped() const noexcept { return tripped_.load(std::memory_order_acquire); }
  void rearm() noexcept { tripped_.store(false, std::memory_order_release); }

 private:
  std::atomic<std::uint64_t> count_{0};
  std::atomic<bool> expected_{false};
  std::atomic<bool> tripped_{false};
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free && std::atomic<bool>::is_always_lock_free);
};

/// Detects a stopped heartbeat. Compares counts, so no common clock is needed. One thread.
class StallDetector {
 public:
  explicit StallDetector(std::int64_t limit_ns) noexcept : limit_ns_(limit_ns) {}

  /// Call regularly. True if a beat is expected and none came for longer than the limit, counted from the
  /// first look that saw the last one.
  [[nodiscard]] bool stalled(const Heartbeat& heart, std::int64_t now_ns) noexcept {
    const std::uint64_t count = heart.count();
    if (!heart.expected() || count != seen_ || !has_seen_) {
      seen_ = count;
      has_seen_ = true;
      since_ns_ = now_ns;
      return false;
    }
    return now_ns - since_ns_ > limit_ns_;
  }
  /// Starts counting at the next look.
  void restart() noexcept { has_seen_ = false; }

 private:
  std::int64_t limit_ns_;
  std::uint64_t seen_ = 0;
  std::int64_t since_ns_ = 0;
  bool has_seen_ = false;
};

}  // namespace palpate::device
