// One session put together: device, servo, governor, watchdog, recorder and clock around whatever renderer is
// felt; run in real time or on a virtual clock. `palpate live` and `palpate record` both are this.
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

#include "device/record/recorder.h"
#include "device/servo/servo_loop.h"
#include "device/servo/servo_thread.h"
#include "device/servo/tick_observer.h"
#include "experiments/live/homing_teller.h"
#include "experiments/live/session_device.h"
#include "experiments/session/progress_bar.h"

namespace palpate::experiments {

/// A force as a line that changes, for devices without motors: "1.10 N [====        ] x +0.00 y +0.00 z
/// +1.10". `full_n` fills the bar.
[[nodiscard]] std::string force_in_words(const Vec3& force_n, double full_n);

/// What every session watches of its own ticks, and how it is armed again: an observer.
class SessionWatch final : public device::TickObserver {
 public:
  /// `auto_rearm`: a second after a fault, for simulated devices, whose faults end by themselves.
  SessionWatch(const device::ReplugDevice& device, bool auto_rearm) noexcept
      : device_(device), auto_rearm_(auto_rearm) {}
  void took(const device::Tick& tick) noexcept override;
  /// Before the first tick: what arms the loop again.
  void rearms_by(device::ServoLoop& loop) noexcept { loop_ = &loop; }
  void rearms_by(device::ServoThread& thread) noexcept { thread_ = &thread; }

  /// Any thread: armed again with the next tick, if then a fault is latched and the device is there.
  void ask_rearm() noexcept { asked_.store(true, std::memory_order_release); }
  /// Of the newest tick. Any thread.
  [[nodiscard]] device::Fault fault() const noexcept { return fault_.load(std::memory_order_acquire); }
  /// The newest force that was commanded, device frame, for people: its axes may be of two ticks.
  [[nodiscard]] Vec3 sent_n() const noexcept {
    return Vec3{sent_n_[0].load(std::memory_order_relaxed), sent_n_[1].load(std::memory_order_relaxed),
                sent_n_[2].load(std::memory_order_relaxed)};
  }
  [[nodiscard]] std::uint64_t contact() const noexcept { return contact_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t faults() const noexcept { return faults_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t missed() const noexcept { return missed_.load(std::memory_order_relaxed); }

 private:
  const device::ReplugDevice& device_;
  bool auto_rearm_;
  device::ServoLoop* loop_ = nullptr;
  device::ServoThread* thread_ = nullptr;
  double since_s_ = 0.0;  // of the fault, or of the device's coming back
  std::atomic<bool> asked_{false};
  std::atomic<device::Fault> fault_{device::Fault::kNone};
  std::array<std::atomic<float>, 3> sent_n_{};
  std::atomic<std::uint64_t> contact_{0}, faults_{0}, missed_{0};
};

/// What a session does besides its ticks.
class SessionTasks {
 public:
  virtual ~SessionTasks() = default;
  /// At `now_s` of the session, again and again; may take long. In real time in a worker's thread, so that
  /// neither the servo nor a key waits for it; else between two ticks.
  virtual void work(double now_s) = 0;
  /// A key of the terminal that the session does not know itself. The main thread's.
  virtual void key(char pressed) = 0;
  /// The session is over: work() that still goes on is to give up. Any thread.
  virtual void ending() noexcept {}
};

/// A remark that somebody made while it ran.
struct SessionMark {
  double t_s = 0.0;
  std::string text;
};

struct SessionSettings {
  double rate_hz = 1000.0;  ///< whole
  double seconds = 10.0;
  Vec3 free_mm = Vec3::Zero();  ///< world: a place known to be free
  double user_limit_n = 0.0;    ///< of the governor
  bool auto_rearm = false;
  std::string label = "live";  ///< of the progress bar
};

/// How it went.
struct SessionEnd {
  device::LoopStatistics loop;
  std::vector<device::DurationBin> lateness;
  std::string scheduling;  ///< what the machine granted
  std::vector<std::string> notes;
  double steal_percent = 0.0;
  std::uint64_t watchdog_trips = 0;
  std::uint64_t replugged = 0;      ///< how often the device came back
  std::uint64_t settled_bytes = 0;  ///< in memory a second after it began: locked, and all touched
  std::vector<SessionMark> marks;
  bool faulted = false;  ///< a fault was latched at the end
};

/// Refers to the device, clock and renderer. Make it, record and observe as wanted, run it once. Of its
/// functions those that say so are for any thread while it runs.
class Assembly {
 public:
  Assembly(const SessionSettings& settings, SessionClock& clock, SessionDevice& device,
           render::HapticRenderer& felt, const device::DeviceMap& map);
  Assembly(const Assembly&) = delete;
  Assembly& operator=(const Assembly&) = delete;

  /// What the governor of such a session is made of.
  [[nodiscard]] static device::GovernorOptions governor_options(const SessionSettings& settings);

  [[nodiscard]] device::Servo& servo() noexcept { return servo_; }
  [[nodiscard]] const SessionWatch& watch() const noexcept { return watch_; }
  /// Ticks go to these in the order given, after the recorder.
  void observe(device::TickObserver& observer) { observers_.push_back(&observer); }
  /// Every tick is recorded; whose file it is, finishes it.
  void record(device::Recorder& recorder) noexcept { recorder_ = &recorder; }

  /// Runs it to its end. Errors: the device does not open, no thread can be had; nothing was felt then.
  [[nodiscard]] Result<SessionEnd> run(SessionTasks& tasks, ProgressBar& progress);

  /// Any thread: after a fault; false where there is none, or the device is not there.
  bool request_rearm() noexcept;
  /// Any thread.
  void request_stop() noexcept { stopping_.store(true, std::memory_order_release); }
  /// Any thread but the servo's; into the recording too, so it may wait for the disk.
  void mark(const std::string& text);
  /// Any thread but the servo's: shown as soon as somebody looks.
  void say(std::string sentence);

 private:
  [[nodiscard]] Result<SessionEnd> run_fast(SessionTasks& tasks, ProgressBar& progress);
  [[nodiscard]] Result<SessionEnd> run_real(SessionTasks& tasks, ProgressBar& progress);
  void look_at_keys(SessionTasks& tasks, double until_s, device::ServoThread& thread, ProgressBar& progress);
  void work(SessionTasks& tasks, double now_s);
  /// Measures once what the session has in memory when it has run for a while.
  void note_settled();
  void replug(double now_s);
  void prompt();
  void show_going_on(ProgressBar& progress);
  [[nodiscard]] const char* armed_by() const noexcept;
  void show_said(ProgressBar& progress);
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
  std::atomic<bool> stopping_{false};
  // The worker's.
  double next_try_s_ = 0.0;
  std::string not_open_;  // why it could not be opened again; empty: it was there
  // The main thread's.
  device::Fault fault_said_ = device::Fault::kNone;
  std::uint64_t settled_bytes_ = 0;
  HomingTeller homing_;
  double force_full_n_ = 0.0;  // what the shown force is a share of
  std::mutex said_mutex_;
  std::vector<std::string> said_;
  std::vector<SessionMark> marks_;
};

}  // namespace palpate::experiments
