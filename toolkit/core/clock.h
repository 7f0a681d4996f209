// Time: what measures phases and frames, and the clock that control loops and the servo go by. One kind of
// clock for all of them, in whole nanoseconds, so that nothing drifts.
#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>

namespace palpate {

/// Nanoseconds on a monotonic clock with an arbitrary start.
[[nodiscard]] inline std::int64_t monotonic_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// Measures from its construction. Never decides anything.
class Stopwatch {
 public:
  [[nodiscard]] double ms() const noexcept { return static_cast<double>(monotonic_ns() - start_ns_) * 1e-6; }
  void restart() noexcept { start_ns_ = monotonic_ns(); }

 private:
  std::int64_t start_ns_ = monotonic_ns();
};

/// Where a loop takes its time from, so that tests run minutes of servo in milliseconds and never wait.
/// Nanoseconds since some start; never goes back.
class Clock {
 public:
  Clock() = default;
  Clock(const Clock&) = delete;
  Clock& operator=(const Clock&) = delete;
  virtual ~Clock() = default;

  [[nodiscard]] virtual std::int64_t now_ns() const noexcept = 0;
  /// The same in seconds: exact to a nanosecond for 104 days.
  [[nodiscard]] double now_s() const noexcept { return static_cast<double>(now_ns()) * 1e-9; }
};

/// The machine's, from its construction on. Any thread.
class MonotonicClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t now_ns() const noexcept override { return monotonic_ns() - start_ns_; }
  /// What the machine's monotonic clock showed at time 0: for sleeping until a time.
  [[nodiscard]] std::int64_t start_ns() const noexcept { return start_ns_; }

 private:
  std::int64_t start_ns_ = monotonic_ns();
};

/// Moves only when told to, and never back. One thread.
class VirtualClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t now_ns() const noexcept override { return now_ns_; }
  /// An earlier time is ignored.
  void advance_to(std::int64_t t_ns) noexcept { now_ns_ = t_ns > now_ns_ ? t_ns : now_ns_; }
  /// To the nearest nanosecond. by_s >= 0; anything else leaves the clock where it is.
  void advance(double by_s) noexcept {
    if (by_s > 0.0) now_ns_ += std::llround(by_s * 1e9);
  }

 private:
  std::int64_t now_ns_ = 0;
};

}  // namespace palpate
