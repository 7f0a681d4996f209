// The work around ticks for any time source: due times, lateness, missed periods, histograms, observers. The
// servo thread uses the machine's clock, tests and accelerated sessions a virtual one.
//
// First:
//   auto loop = palpate::device::ServoLoop::create(servo, clock, 1000);
//   if (!loop) return failed(loop.error());
//   const auto ticks =
//       palpate::device::run_accelerated(**loop, virtual_clock, 60'000'000'000, [] { return true; });
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include <palpate/clock.h>
#include <palpate/device/loop_histogram.h>
#include <palpate/device/servo.h>

namespace palpate::device {

inline constexpr std::int64_t kMinServoHz = 500, kMaxServoHz = 8000;

/// Due times: tick k at floor(k 10^9 / rate) ns after the first, without drift.
class DueTimes {
 public:
  explicit DueTimes(std::int64_t rate_hz) noexcept : rate_hz_(rate_hz) {}

  /// The next tick is due at `t_ns`; later ones follow from it.
  void begin(std::int64_t t_ns) noexcept {
    first_ns_ = t_ns;
    next_ = 0;
  }
  [[nodiscard]] std::int64_t due_ns() const noexcept { return at(next_); }
  /// A tick begins at `now_ns`, not before its due time. Skips whole periods that passed and returns their
  /// number.
  std::uint64_t take(std::int64_t now_ns) noexcept;
  /// Rounded down.
  [[nodiscard]] std::int64_t period_ns() const noexcept;

 private:
  [[nodiscard]] std::int64_t at(std::int64_t tick) const noexcept;

  std::int64_t rate_hz_;
  std::int64_t first_ns_ = 0;
  std::int64_t next_ = 0;
};

/// Runs a servo's ticks. Keeps references to servo, clock (the servo's own) and observers. begin and tick
/// belong to one thread; request_rearm and histograms are thread-safe.
class ServoLoop {
 public:
  static constexpr std::size_t kMaxObservers = 12;

  /// Whole Hz, kMinServoHz to kMaxServoHz; observers are fixed and called in this order.
  [[nodiscard]] static Result<std::unique_ptr<ServoLoop>> create(
      Servo& servo, const Clock& clock, std::int64_t rate_hz, std::span<TickObserver* const> observers = {});

  /// Makes the first tick due now. The servo must have been started.
  void begin() noexcept {
    faults_before_ = thread_page_faults();
    due_.begin(clock_.now_ns());
  }
  /// After the last tick, by the thread that began: counts its page faults.
  void end() noexcept { histograms_.fault(thread_page_faults() - faults_before_); }
  [[nodiscard]] const DueTimes& due() const noexcept { return due_; }
  /// One tick at or after its due time. Lateness over a period skips whole periods, counted as missed and
  /// never caught up. A tick that restarted the renderer (O(points)) restarts the due times, as it does the
  /// governor's. Allocates nothing itself.
  Tick tick() noexcept;

  /// The next tick begins with Servo::rearm. Any thread, lock-free.
  void request_rearm() noexcept { rearm_.store(true, std::memory_order_release); }
  /// Any thread, at any time.
  [[nodiscard]] const LoopHistograms& histograms() const noexcept { return histograms_; }

 private:
  ServoLoop(Servo& servo, const Clock& clock, std::int64_t rate_hz,
            std::span<TickObserver* const> observers) noexcept;
  void count(const Tick& tick, std::int64_t began_ns) noexcept;

  Servo& servo_;
  const Clock& clock_;
  DueTimes due_;
  std::array<TickObserver*, kMaxObservers> observers_{};
  std::size_t observers_count_ = 0;
  std::int64_t before_ns_ = 0;  // begin of the last tick
  PageFaults faults_before_;
  bool has_before_ = false;
  std::atomic<bool> rearm_{false};
  LoopHistograms histograms_;
};

/// Runs the loop without waiting until the clock shows `until_ns` or `going_on` is false (asked before each
/// tick; empty: always), every tick exactly at its due time. The servo must be started and is not stopped.
/// Returns the number of ticks.
template <class GoingOn>
std::uint64_t run_accelerated(ServoLoop& loop, VirtualClock& clock, std::int64_t until_ns,
                              GoingOn&& going_on) {
  std::uint64_t ticks = 0;
  loop.begin();
  while (loop.due().due_ns() <= until_ns && going_on()) {
    clock.advance_to(loop.due().due_ns());
    loop.tick();
    ++ticks;
  }
  loop.end();
  return ticks;
}

}  // namespace palpate::device
