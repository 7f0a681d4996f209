// Runs a servo in real time on its own thread: 0.5 to 8 kHz, absolute deadlines, the best scheduling granted.
// Recipe: the PREEMPT_RT project's guide to cyclic tasks.
//
// First:
//   auto thread = palpate::device::ServoThread::create(servo, clock, {});
//   if (!thread) return failed(thread.error());
//   if (auto started = (*thread)->start(); !started) return failed(started.error());
//   // .. until the user has had enough:
//   (*thread)->stop();  // zero force, device closed
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <thread>

#include <palpate/device/scheduling.h>
#include <palpate/device/servo_loop.h>
#include <palpate/progress.h>

namespace palpate::device {

struct ServoThreadOptions {
  std::int64_t rate_hz = 1000;  ///< kMinServoHz to kMaxServoHz; equal to the governor's
  SchedulingOptions scheduling;
  std::optional<Vec3> free_mm;  ///< as in Servo::start
  bool spin = true;             ///< ends each wait awake, for exactness; under SCHED_FIFO only
};

/// Between start and stop the servo, its renderer, governor, device and observers belong to the thread.
/// However it ends (stop, destructor, request_stop, program stop), the device last gets zero force and is
/// closed. start, stop and the destructor belong to one thread; request_rearm, request_stop, running and
/// loop().histograms() are lock-free for any.
class ServoThread {
 public:
  /// The clock must be the servo's. Errors: rate out of range, too many observers.
  [[nodiscard]] static Result<std::unique_ptr<ServoThread>> create(
      Servo& servo, const MonotonicClock& clock, const ServoThreadOptions& options,
      std::span<TickObserver* const> observers = {});
  ~ServoThread() { stop(); }
  ServoThread(const ServoThread&) = delete;
  ServoThread& operator=(const ServoThread&) = delete;

  /// Opens the device and begins; returns when the thread is scheduled, before the first tick. Once only.
  /// Errors: the device does not open, no thread, already started.
  [[nodiscard]] Status start();
  /// On return: zero force, device closed, thread ended. Repeatable, also without start.
  void stop() noexcept;
  /// The same without waiting, within a tick. Observers may call it.
  void request_stop() noexcept { stopping_.store(true, std::memory_order_release); }
  /// After a fault: arms at the next tick, with a soft start.
  void request_rearm() noexcept { loop_->request_rearm(); }

  /// Between start and the end of the last tick.
  [[nodiscard]] bool running() const noexcept { return running_.load(std::memory_order_acquire); }
  [[nodiscard]] const LoopHistograms& histograms() const noexcept { return loop_->histograms(); }
  /// Scheduling that start() obtained. Valid after it.
  [[nodiscard]] const SchedulingMode& mode() const noexcept { return mode_; }
  /// Steal of its pinned CPU, or of all, from start to now or the end.
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
  StopCallback stop_callback_;
  std::thread thread_;
  bool started_ = false;
  std::int64_t owed_ns_ = 0;    // sleep owed to the rest of the machine
  std::int64_t looked_ns_ = 0;  // counted up to here
  std::atomic<bool> stopping_{false};
  std::atomic<bool> running_{false};
};

}  // namespace palpate::device
