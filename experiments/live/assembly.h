// One session: device, servo, governor, watchdog, recorder and clock around any renderer, in real time or on
// a virtual clock. Used by `palpate live` and `palpate live record`.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <palpate/device/servo.h>
#include <palpate/device/servo_loop.h>
#include <palpate/device/servo_thread.h>
#include <palpate/progress.h>
#include "device/record/recorder.h"
#include "experiments/live/session_device.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

/// Switches the terminal to single keys without echo while it lives. Gives no keys if standard input is no
/// terminal. Restores the terminal however the program ends.
class Keys {
 public:
  Keys();
  ~Keys();
  Keys(const Keys&) = delete;
  Keys& operator=(const Keys&) = delete;
  /// The next key pressed, without waiting.
  [[nodiscard]] std::optional<char> next();
  [[nodiscard]] bool there() const noexcept { return raw_; }

 private:
  void give_back() noexcept;
  bool raw_ = false;
  StopCallback stop_callback_;
};

/// Resident memory of the process in bytes, after returning freed memory to the system. Not for the servo's
/// thread: takes the heap's locks and reads a file.
[[nodiscard]] std::uint64_t resident_bytes();

/// A force as a changing line for devices without motors: "1.10 N [====        ] x +0.00 y +0.00 z +1.10".
/// `full_n` fills the bar.
[[nodiscard]] std::string force_in_words(const Vec3& force_n, double full_n);

/// Observes a session's ticks and rearms the loop after a fault.
class SessionWatch final : public device::TickObserver {
 public:
  /// `auto_rearm`: rearms a second after a fault, for simulated devices, whose faults end by themselves.
  SessionWatch(const device::ReconnectingDevice& device, bool auto_rearm) noexcept
      : device_(device), auto_rearm_(auto_rearm) {}
  void took(const device::Tick& tick) noexcept override;
  /// Sets what rearms the loop; call before the first tick.
  void rearms_by(device::ServoLoop& loop) noexcept { loop_ = &loop; }
  void rearms_by(device::ServoThread& thread) noexcept { thread_ = &thread; }

  /// Any thread: rearms at the next tick if a fault is latched and the device is present.
  void ask_rearm() noexcept { asked_.store(true, std::memory_order_release); }
  /// Any thread: in real time the next tick is the last, whatever the main thread is busy with.
  void ask_stop() noexcept { stop_.store(true, std::memory_order_release); }
  /// Fault of the newest tick. Any thread.
  [[nodiscard]] device::Fault fault() const noexcept { return fault_.load(std::memory_order_acquire); }
  /// Newest commanded force, device frame, for display: its axes may come from two ticks.
  [[nodiscard]] Vec3 sent_n() const noexcept {
    const auto newton = [this](std::size_t axis) {
      return static_cast<double>(sent_n_[axis].load(std::memory_order_relaxed));
    };
    return Vec3{newton(0), newton(1), newton(2)};
  }
  [[nodiscard]] std::uint64_t contact() const noexcept { return contact_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t faults() const noexcept { return faults_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t missed() const noexcept { return missed_.load(std::memory_order_relaxed); }

 private:
  const device::ReconnectingDevice& device_;
  bool auto_rearm_;
  device::ServoLoop* loop_ = nullptr;
  device::ServoThread* thread_ = nullptr;
  double since_s_ = 0.0;  // since the fault or the device's return
  std::atomic<bool> asked_{false}, stop_{false};
  std::atomic<device::Fault> fault_{device::Fault::kNone};
  std::array<std::atomic<float>, 3> sent_n_{};
  std::atomic<std::uint64_t> contact_{0}, faults_{0}, missed_{0};
};

/// A session's work besides its ticks.
class SessionTasks {
 public:
  virtual ~SessionTasks() = default;
  /// Called repeatedly at `now_s` of the session; may take long. Runs in a worker thread in real time, so
  /// neither the servo nor the keys wait for it; on a virtual clock between two ticks.
  virtual void work(double now_s) = 0;
  /// Handles a terminal key that the session itself does not use. Main thread.
  virtual void key(char pressed) = 0;
  /// The session has ended: a running work() must give up. Any thread.
  virtual void ending() noexcept {}
};

/// A remark made during the session.
struct SessionMark {
  double t_s = 0.0;
  std::string text;
};

struct SessionSettings {
  double rate_hz = 1000.0;  ///< a whole number
  double seconds = 10.0;
  Vec3 free_mm = Vec3::Zero();  ///< world frame, known to be free
  double user_limit_n = 0.0;    ///< the governor's
  bool auto_rearm = false;
  std::string label = "live";  ///< label of the progress bar
};

/// The result of a session.
struct SessionEnd {
  device::LoopStatistics loop;
  std::vector<device::DurationBin> lateness;
  std::string scheduling;  ///< granted by the system
  std::vector<std::string> notes;
  double steal_percent = 0.0;
  std::uint64_t watchdog_trips = 0;
  std::uint64_t replugged = 0;      ///< times the device came back
  std::uint64_t settled_bytes = 0;  ///< resident memory a second after the start: locked, and all of it
                                    ///< touched
  std::vector<SessionMark> marks;
  bool faulted = false;  ///< a fault was latched at the end
};

/// Refers to device, clock and renderer. Add the recorder and observers, then run once. Functions marked "any
/// thread" may be called while it runs.
class Assembly {
 public:
  Assembly(const SessionSettings& settings, SessionClock& clock, SessionDevice& device,
           render::HapticRenderer& felt, const device::DeviceMap& map);
  Assembly(const Assembly&) = delete;
  Assembly& operator=(const Assembly&) = delete;

  /// The governor's options for such a session.
  [[nodiscard]] static device::GovernorOptions governor_options(const SessionSettings& settings);

  [[nodiscard]] device::Servo& servo() noexcept { return servo_; }
  [[nodiscard]] const SessionWatch& watch() const noexcept { return watch_; }
  /// Adds an observer; observers get ticks in this order, after the recorder.
  void observe(device::TickObserver& observer) { observers_.push_back(&observer); }
  /// Records every tick; the file's owner finishes it.
  void record(device::Recorder& recorder) noexcept { recorder_ = &recorder; }

  /// Runs the session to its end. Errors: the device does not open or no thread is available; no force was
  /// rendered then.
  [[nodiscard]] Result<SessionEnd> run(SessionTasks& tasks, ProgressBar& progress);

  /// Any thread: rearms after a fault; false without a fault or device.
  bool request_rearm() noexcept;
  /// Any thread: ends it as if its seconds were over.
  void request_stop() noexcept {
    stopping_.store(true, std::memory_order_release);
    watch_.ask_stop();
  }
  /// The same, for a thread that may wait until the device is let go. False: it is not, in two seconds.
  [[nodiscard]] bool stop_soon() noexcept;
  /// Any thread but the servo's. Also writes to the recording, so it may wait for the disk.
  void mark(const std::string& text);
  /// Any thread but the servo's: shown at the next poll.
  void announce(std::string sentence);

 private:
  [[nodiscard]] Result<SessionEnd> run_fast(SessionTasks& tasks, ProgressBar& progress);
  [[nodiscard]] Result<SessionEnd> run_real(SessionTasks& tasks, ProgressBar& progress);
  void poll_keys(SessionTasks& tasks, double until_s, device::ServoThread& thread, ProgressBar& progress);
  void work(SessionTasks& tasks, double now_s);
  /// Measures the session's memory once, after it has settled.
  void note_settled();
  void replug(double now_s);
  void prompt();
  void show_going_on(ProgressBar& progress);
  [[nodiscard]] const char* armed_by() const noexcept;
  void show_reports(ProgressBar& progress);
  void note_scheduling(const std::string& scheduling);
  [[nodiscard]] SessionEnd ended(const device::LoopHistograms& histograms);
  [[nodiscard]] double now_s() const noexcept;

  SessionSettings settings_;
  SessionClock& clock_;
  SessionDevice& device_;
  device::Servo servo_;
  SessionWatch watch_;
  std::vector<device::TickObserver*> observers_;
  device::Recorder* recorder_ = nullptr;
  std::atomic<std::int64_t> begun_ns_{0};
  std::atomic<bool> stopping_{false}, let_go_{false};
  // Used by the worker only.
  double next_try_s_ = 0.0;
  std::string not_open_;  // why reopening failed; empty: present
  // Used by the main thread only.
  device::Fault fault_reported_ = device::Fault::kNone;
  std::uint64_t settled_bytes_ = 0;
  HomingTeller homing_;
  double force_full_n_ = 0.0;  // full scale of the shown force
  std::mutex reports_mutex_;
  std::vector<std::string> reports_;
  std::vector<SessionMark> marks_;
};

}  // namespace palpate::experiments
