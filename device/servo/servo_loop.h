// What is done from tick to tick, whatever makes the time pass: due times, lateness, missed periods,
// histograms, observers. The servo thread runs it on the machine's clock, tests and accelerated sessions on a
// virtual one.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "device/servo/loop_histogram.h"
#include "device/servo/servo.h"
#include "device/servo/tick_observer.h"
#include "toolkit/core/clock.h"

namespace palpate::device {

inline constexpr std::int64_t kLeastServoHz = 500, kMostServoHz = 8000;

/// When ticks are due: tick k at floor(k 10^9 / rate) ns after the first, so that nothing drifts.
class DueTimes {
 public:
  explicit DueTimes(std::int64_t rate_hz) noexcept : rate_hz_(rate_hz) {}

  /// The next tick is due at `t_ns`, and the others after it.
  void begin(std::int64_t t_ns) noexcept {
    first_ns_ = t_ns;
    next_ = 0;
  }
  [[nodiscard]] std::int64_t due_ns() const noexcept { return at(next_); }
  [[nodiscard]] std::int64_t following_ns() const noexcept { return at(next_ + 1); }
  /// A tick begins at `now_ns`, at its due time or later. Periods that have passed whole since are skipped:
  /// how many.
  std::uint64_t take(std::int64_t now_ns) noexcept;
  /// Rounded down.
  [[nodiscard]] std::int64_t period_ns() const noexcept;

 private:
  [[nodiscard]] std::int64_t at(std::int64_t tick) const noexcept;

  std::int64_t rate_hz_;
  std::int64_t first_ns_ = 0;
  std::int64_t next_ = 0;
};

/// Ticks of a servo, each at its time. Keeps references to servo, clock (the servo's own) and observers.
/// begin and tick belong to one thread; request_rearm and histograms are for any.
class ServoLoop {
 public:
  static constexpr std::size_t kMostObservers = 12;

  /// Whole Hz, kLeastServoHz to kMostServoHz; the observers are fixed from here on and called in this order.
  [[nodiscard]] static Result<std::unique_ptr<ServoLoop>> create(
      Servo& servo, const Clock& clock, std::int64_t rate_hz, std::span<TickObserver* const> observers = {});

  /// The first tick is due now. The servo must have been started.
  void begin() noexcept { due_.begin(clock_.now_ns()); }
  [[nodiscard]] const DueTimes& due() const noexcept { return due_; }
  /// One tick, at its due time or later. A tick late by over a period is one tick: the whole periods in
  /// between are counted as missed, never made up for. A tick that restarted the renderer, in O(points),
  /// begins the due times anew, as it begins the governor's. Allocates nothing of its own.
  Tick tick() noexcept;

  /// The next tick begins with Servo::rearm. Any thread, lock-free.
  void request_rearm() noexcept { rearm_.store(true, std::memory_order_release); }
  /// Any thread, while it runs too.
  [[nodiscard]] const LoopHistograms& histograms() const noexcept { return histograms_; }

 private:
  ServoLoop(Servo& servo, const Clock& clock, std::int64_t rate_hz,
            std::span<TickObserver* const> observers) noexcept;
  void count(const Tick& tick, std::int64_t began_ns) noexcept;

  Servo& servo_;
  const Clock& clock_;
  DueTimes due_;
  std::array<TickObserver*, kMostObservers> observers_{};
  std::size_t observers_count_ = 0;
  std::int64_t before_ns_ = 0;  // when the tick before began
  bool has_before_ = false;
  std::atomic<bool> rearm_{false};
  LoopHistograms histograms_;
};

/// Runs the loop as fast as it goes until the clock shows `until_ns` or `going_on` says no (asked before each
/// tick; empty: always): every tick exactly at its due time. The servo must have been started, and is not
/// stopped. How many ticks.
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
  return ticks;
}

}  // namespace palpate::device
