// Clocks for phases, frames, control loops and the servo. All use whole nanoseconds, so nothing drifts.
//
// First:
//   palpate::MonotonicClock clock;  // VirtualClock in tests: it moves only when told to
//   const palpate::Stopwatch watch;
//   const render::Frame frame = renderer->step(hip_mm, clock.now_s());
//   std::printf("%g ms, contact %d\n", watch.ms(), frame.contact);
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

/// Measures time since its construction; for reports only, never for decisions.
class Stopwatch {
 public:
  [[nodiscard]] double ms() const noexcept { return static_cast<double>(monotonic_ns() - start_ns_) * 1e-6; }
  void restart() noexcept { start_ns_ = monotonic_ns(); }

 private:
  std::int64_t start_ns_ = monotonic_ns();
};

/// The time source of a loop. Tests use a virtual one and run minutes of servo in milliseconds. Unit:
/// nanoseconds since an arbitrary start; never goes back.
class Clock {
 public:
  Clock() = default;
  Clock(const Clock&) = delete;
  Clock& operator=(const Clock&) = delete;
  virtual ~Clock() = default;

  [[nodiscard]] virtual std::int64_t now_ns() const noexcept = 0;
  /// The time in seconds, exact to a nanosecond for 104 days.
  [[nodiscard]] double now_s() const noexcept { return static_cast<double>(now_ns()) * 1e-9; }
};

/// The machine's monotonic clock, 0 at construction. Thread-safe.
class MonotonicClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t now_ns() const noexcept override { return monotonic_ns() - start_ns_; }
  /// The machine clock's reading at time 0, for sleeping until an absolute time.
  [[nodiscard]] std::int64_t start_ns() const noexcept { return start_ns_; }

 private:
  std::int64_t start_ns_ = monotonic_ns();
};

/// A clock that moves only by advance() and advance_to(), never back. For one thread.
class VirtualClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t now_ns() const noexcept override { return now_ns_; }
  /// An earlier time is ignored.
  void advance_to(std::int64_t t_ns) noexcept { now_ns_ = t_ns > now_ns_ ? t_ns : now_ns_; }
  /// Rounds to the nearest nanosecond. Ignores by_s unless it is >= 0.
  void advance(double by_s) noexcept {
    if (by_s > 0.0) now_ns_ += std::llround(by_s * 1e9);
  }

 private:
  std::int64_t now_ns_ = 0;
};

}  // namespace palpate
