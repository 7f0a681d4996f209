// Clocks, page faults, and bounds of what is measured.
// Clocks measure phases and frames and drive control loops and the servo, in whole nanoseconds, so nothing
// drifts. Page faults show a frame that waits for the system's memory.
//
// First:
//   palpate::MonotonicClock clock;  // VirtualClock in tests: it moves only when told to
//   const palpate::Stopwatch watch;
//   const render::Frame frame = renderer->step(hip_mm, clock.now_s());
//   std::printf("%g ms, contact %d\n", watch.ms(), frame.contact);
//
// Page faults of a frame:
//   const palpate::PageFaults before = palpate::thread_page_faults();
//   const render::Frame frame = renderer->step(hip_mm, 0.0);
//   const palpate::PageFaults faults = palpate::thread_page_faults() - before;  // 0 and 0
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

/// Pages that a thread met for the first time (minor), or that were read from disk (major).
struct PageFaults {
  std::uint64_t minor = 0, major = 0;
  PageFaults& operator+=(const PageFaults& more) noexcept {
    minor += more.minor;
    major += more.major;
    return *this;
  }
  PageFaults operator-(const PageFaults& before) const noexcept {
    return {minor - before.minor, major - before.major};
  }
};

/// Page faults of the calling thread since it began; 0 where the system does not tell. One system call.
[[nodiscard]] PageFaults thread_page_faults() noexcept;

/// A confidence interval: holds 95 % of the resampled numbers.
struct Interval {
  double low = 0.0, high = 0.0;
};

}  // namespace palpate
