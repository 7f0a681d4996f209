// The thread that runs a servo in real time: at 0.5 to 8 kHz, by absolute deadlines, with what scheduling the
// machine grants. Source of the recipe: the PREEMPT_RT project's guide to cyclic tasks.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <thread>

#include "device/servo/scheduling.h"
#include "device/servo/servo_loop.h"
#include "toolkit/core/at_stop.h"

namespace palpate::device {

struct ServoThreadOptions {
  std::int64_t rate_hz = 1000;  ///< kLeastServoHz to kMostServoHz; the governor's period must be the same
  SchedulingOptions scheduling;
  std::optional<Vec3> free_mm;  ///< as Servo::start takes it
  bool spin = true;             ///< the last of each wait awake, for exactness; under SCHED_FIFO alone
};

/// Runs `servo` on a thread of its own. Between start and stop the servo, its renderer, governor and device
/// and the observers belong to that thread; nobody else may touch them. However it ends (stop, destructor,
/// request_stop, the program told to stop), the last that happens to the device is zero force and close.
/// start, stop and the destructor belong to one thread; request_rearm, request_stop, running and
/// loop().histograms() are for any, lock-free.
class ServoThread {
 public:
  /// The clock must be the servo's own. Errors: a rate out of range, too many observers.
  [[nodiscard]] static Result<std::unique_ptr<ServoThread>> create(
      Servo& servo, const MonotonicClock& clock, const ServoThreadOptions& options,
      std::span<TickObserver* const> observers = {});
  ~ServoThread() { stop(); }
  ServoThread(const ServoThread&) = delete;
  ServoThread& operator=(const ServoThread&) = delete;

  /// Opens the device and begins; returns when the thread has its scheduling, before the first tick. Once
  /// only. Errors: the device does not open, no thread can be had; started before.
  [[nodiscard]] Status start();
  /// Zero force, device closed, thread ended: when it returns. Twice and without start too.
  void stop() noexcept;
  /// The same, without waiting: at most a tick later. An observer may call it.
  void request_stop() noexcept { stopping_.store(true, std::memory_order_release); }
  /// After a fault: armed again with the next tick, with a soft start.
  void request_rearm() noexcept { loop_->request_rearm(); }

  /// Between start and the end of the last tick.
  [[nodiscard]] bool running() const noexcept { return running_.load(std::memory_order_acquire); }
  [[nodiscard]] const LoopHistograms& histograms() const noexcept { return loop_->histograms(); }
  /// What start obtained. Valid after it.
  [[nodiscard]] const SchedulingMode& mode() const noexcept { return mode_; }
  /// Of the CPU that it is pinned to, or of all, since start, to now or to the end.
  [[nodiscard]] double steal_percent() const;

 private:
  ServoThread(Servo& servo, const MonotonicClock& clock, const ServoThreadOptions& options,
              std::unique_ptr<ServoLoop> loop) noexcept;
  void run() noexcept;
  void wait() noexcept;

  Servo& servo_;
  const MonotonicClock& clock_;
  ServoThreadOptions options_;
  std::unique_ptr<ServoLoop> loop_;
  SchedulingMode mode_;
  StealTimes steal_at_start_, steal_at_end_;
  std::unique_ptr<ProcessRealTime> process_;
  AtStop at_stop_;
  std::thread thread_;
  bool started_ = false;
  std::int64_t owed_ns_ = 0;    // sleep that the thread owes the rest of the machine
  std::int64_t looked_ns_ = 0;  // up to when that was counted
  std::atomic<bool> stopping_{false};
  std::atomic<bool> running_{false};
};

}  // namespace palpate::device
