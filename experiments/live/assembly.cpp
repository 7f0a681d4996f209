#include "experiments/live/assembly.h"

#include <fmt/format.h>
#include <malloc.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <map>
#include <thread>
#include <utility>

#include <palpate/device/servo_thread.h>
#include <palpate/device/watchdog.h>
#include <palpate/result.h>
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

termios terminal_before;

}  // namespace

Keys::Keys() {
  if (isatty(STDIN_FILENO) == 0 || tcgetattr(STDIN_FILENO, &terminal_before) != 0) return;
  termios raw = terminal_before;
  raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  stop_callback_ = StopCallback([this] {
    give_back();
    return std::string();
  });
  raw_ = tcsetattr(STDIN_FILENO, TCSANOW, &raw) == 0;
}

Keys::~Keys() {
  stop_callback_.drop();
  give_back();
}

void Keys::give_back() noexcept {
  if (raw_) tcsetattr(STDIN_FILENO, TCSANOW, &terminal_before);
}

std::optional<char> Keys::next() {
  if (!raw_) return std::nullopt;
  pollfd input{STDIN_FILENO, POLLIN, 0};
  char key = 0;
  if (poll(&input, 1, 0) <= 0 || read(STDIN_FILENO, &key, 1) != 1) return std::nullopt;
  return key;
}

std::uint64_t resident_bytes() {
  malloc_trim(0);
  std::ifstream file("/proc/self/statm");
  std::uint64_t pages = 0, in_memory = 0;
  file >> pages >> in_memory;
  return in_memory * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

namespace {

using DeviceFactTexts = std::map<std::string, std::string>;

DeviceFactTexts facts_of(const SessionDevice& device) {
  const auto told = device.facts();
  return {told.begin(), told.end()};
}

constexpr double kSessionNsPerS = 1e9;
// Polling period of keys and messages (main thread) and due work (worker), below what a person notices.
constexpr std::chrono::milliseconds kLookEvery{20};
// Delay before rearming: a simulated device's fault ends by itself, like a person letting go and rearming.
constexpr double kRearmAfterS = 1.0;
// Retry period for a lost device: prompt for the person who plugs it in, rare enough for the bus.
constexpr double kTryEveryS = 0.5;
// Time after which real-time memory is locked and every renderer has been stepped.
constexpr double kSettledAfterS = 1.0;

/// A thread that polls until this object is destroyed, which joins it.
class PollingThread {
 public:
  template <class Poll>
  explicit PollingThread(Poll poll)
      : thread_([this, poll = std::move(poll)] {
          while (!ending_.load(std::memory_order_acquire)) {
            poll();
            std::this_thread::sleep_for(kLookEvery);
          }
        }) {}
  PollingThread(const PollingThread&) = delete;
  PollingThread& operator=(const PollingThread&) = delete;
  ~PollingThread() {
    ending_.store(true, std::memory_order_release);
    thread_.join();
  }

 private:
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace

std::string force_in_words(const Vec3& force_n, double full_n) {
  constexpr int kCells = 12;  // enough steps for a glance
  const double share = full_n > 0.0 && is_finite(force_n) ? force_n.norm() / full_n : 0.0;
  const int filled = std::clamp(static_cast<int>(std::ceil(share * kCells)), 0, kCells);
  return fmt::format("{:5.2f} N [{}{}] x {:+.2f} y {:+.2f} z {:+.2f}", force_n.norm(),
                     std::string(static_cast<std::size_t>(filled), '='),
                     std::string(static_cast<std::size_t>(kCells - filled), ' '), force_n.x(), force_n.y(),
                     force_n.z());
}

void SessionWatch::took(const device::Tick& tick) noexcept {
  if (stop_.load(std::memory_order_acquire) && thread_ != nullptr) thread_->request_stop();
  if (tick.frame.contact) contact_.fetch_add(1, std::memory_order_relaxed);
  if (tick.missed > 0) missed_.fetch_add(tick.missed, std::memory_order_relaxed);
  for (std::size_t axis = 0; axis < sent_n_.size(); ++axis)
    sent_n_[axis].store(static_cast<float>(tick.sent_n[static_cast<Eigen::Index>(axis)]),
                        std::memory_order_relaxed);
  const bool here = device_.here();
  const bool faulted = tick.fault != device::Fault::kNone;
  const bool before = fault_.exchange(tick.fault, std::memory_order_acq_rel) != device::Fault::kNone;
  if (faulted && !before) faults_.fetch_add(1, std::memory_order_relaxed);
  if (!faulted || !before || !here) since_s_ = tick.t_s;
  const bool asked = asked_.exchange(false, std::memory_order_acquire);
  if (!faulted || !here) return;
  if (!asked && !(auto_rearm_ && tick.t_s - since_s_ >= kRearmAfterS)) return;
  since_s_ = tick.t_s;
  if (loop_ != nullptr) loop_->request_rearm();
  if (thread_ != nullptr) thread_->request_rearm();
}

device::GovernorOptions Assembly::governor_options(const SessionSettings& settings) {
  device::GovernorOptions options;
  options.period_s = 1.0 / settings.rate_hz;
  options.user_limit_n = settings.user_limit_n;
  return options;
}

Assembly::Assembly(const SessionSettings& settings, SessionClock& clock, SessionDevice& device,
                   render::HapticRenderer& felt, const device::DeviceMap& map)
    : settings_(settings),
      clock_(clock),
      device_(device),
      servo_(felt, governor_options(settings), device.device(), clock.clock(), map),
      watch_(device.device(), settings.auto_rearm),
      homing_(device, "; force comes with a soft start") {}

double Assembly::now_s() const noexcept {
  return static_cast<double>(clock_.clock().now_ns() - begun_ns_) / kSessionNsPerS;
}

bool Assembly::request_rearm() noexcept {
  if (watch_.fault() == device::Fault::kNone || !device_.device().here()) return false;
  watch_.ask_rearm();
  return true;
}

void Assembly::mark(const std::string& text) {
  const double t_s = now_s();
  {
    const std::lock_guard lock(reports_mutex_);
    marks_.push_back({t_s, text});
  }
  // The recording counts write errors itself.
  if (recorder_ != nullptr) (void)recorder_->note("mark: " + text);
}

void Assembly::announce(std::string sentence) {
  const std::lock_guard lock(reports_mutex_);
  reports_.push_back(std::move(sentence));
}

void Assembly::show_reports(ProgressBar& progress) {
  std::vector<std::string> sentences;
  {
    const std::lock_guard lock(reports_mutex_);
    sentences.swap(reports_);
  }
  if (sentences.empty()) return;
  progress.clear();
  for (const std::string& sentence : sentences) tell("palpate: {}\n", sentence);
}

const char* Assembly::armed_by() const noexcept {
  return settings_.auto_rearm ? ", in a second" : " (key r)";
}

/// Reopens a lost device outside the servo's thread.
void Assembly::replug(double now_s) {
  if (!device_.device().lost() || now_s < next_try_s_) return;
  if (not_open_.empty()) announce(device_.device().name() + " is gone; plug it in again");
  next_try_s_ = now_s + kTryEveryS;
  const Status opened = device_.device().reopen();
  if (!opened) {
    // Reports each reason once: first that the device is missing, then any other error.
    if (std::exchange(not_open_, opened.error().message()) != opened.error().message()) announce(not_open_);
    return;
  }
  if (!device_.device().here()) return;
  not_open_.clear();
  announce(device_.device().name() + " is back; no force until it is armed again" + armed_by());
}

void Assembly::work(SessionTasks& tasks, double now_s) {
  replug(now_s);
  tasks.work(now_s);
}

/// Tells the person at the device what to do.
void Assembly::prompt() {
  const device::Fault fault = watch_.fault();
  if (fault != fault_reported_ && fault != device::Fault::kNone)
    announce(
        fmt::format("fault: {}; no force until it is armed again{}", device::fault_name(fault), armed_by()));
  fault_reported_ = fault;
  if (std::optional<std::string> news = homing_.news()) announce(*std::move(news));
}

void Assembly::note_scheduling(const std::string& scheduling) {
  if (recorder_ != nullptr) (void)recorder_->note("scheduling: " + scheduling);
}

SessionEnd Assembly::ended(const device::LoopHistograms& histograms) {
  SessionEnd end;
  end.loop = histograms.statistics();
  end.lateness = histograms.lateness.bins();
  end.replugged = device_.device().times_back();
  end.faulted = watch_.fault() != device::Fault::kNone;
  end.settled_bytes = settled_bytes_ != 0 ? settled_bytes_ : resident_bytes();
  const std::lock_guard lock(reports_mutex_);
  end.marks = marks_;
  return end;
}

bool Assembly::stop_soon() noexcept {
  constexpr std::chrono::milliseconds kPatience{2000}, kLook{1};
  request_stop();
  if (clock_.accelerated()) return true;  // nobody holds anything
  for (auto waited = kLook; !let_go_.load(std::memory_order_acquire) && waited < kPatience; waited += kLook)
    std::this_thread::sleep_for(kLook);
  return let_go_.load(std::memory_order_acquire);
}

Result<SessionEnd> Assembly::run(SessionTasks& tasks, ProgressBar& progress) {
  if (recorder_ != nullptr) observers_.insert(observers_.begin(), recorder_);
  observers_.push_back(&watch_);
  const DeviceFactTexts at_opening = facts_of(device_);
  if (recorder_ != nullptr)
    for (const auto& [key, value] : at_opening)
      (void)recorder_->note(fmt::format("device at the opening: {}: {}", key, value));
  Result<SessionEnd> end = clock_.accelerated() ? run_fast(tasks, progress) : run_real(tasks, progress);
  show_reports(progress);
  // Counters include the whole session; a closed device may report nothing more.
  DeviceFactTexts facts = facts_of(device_);
  facts.insert(at_opening.begin(), at_opening.end());
  for (const auto& [key, value] : facts) {
    if (recorder_ != nullptr) (void)recorder_->note(fmt::format("device: {}: {}", key, value));
    if (end) end->notes.push_back(fmt::format("{}: {}", key, value));
  }
  return end;
}

Result<SessionEnd> Assembly::run_fast(SessionTasks& tasks, ProgressBar& progress) {
  VirtualClock& clock = clock_.virtual_clock();
  PALPATE_TRY(servo_.start(settings_.free_mm));
  PALPATE_ASSIGN(std::unique_ptr<device::ServoLoop> loop,
                 device::ServoLoop::create(servo_, clock, std::llround(settings_.rate_hz), observers_));
  watch_.rearms_by(*loop);
  const std::string scheduling = "accelerated: a virtual clock, every tick at its due time";
  note_scheduling(scheduling);
  begun_ns_ = clock.now_ns();
  const std::int64_t until_ns = begun_ns_ + std::llround(settings_.seconds * kSessionNsPerS);
  const auto report_every = static_cast<std::uint64_t>(settings_.rate_hz);  // one second of the session
  std::uint64_t asked = 0;
  device::run_accelerated(*loop, clock, until_ns, [&] {
    work(tasks, now_s());
    if (recorder_ != nullptr) recorder_->wait_for_room();
    if (asked++ % report_every == 0) {
      note_settled();
      prompt();
      show_reports(progress);
      progress.report(settings_.label + ", accelerated", now_s() / settings_.seconds);
    }
    return !stopping_.load(std::memory_order_acquire);
  });
  servo_.stop();
  SessionEnd end = ended(loop->histograms());
  end.scheduling = scheduling;
  return end;
}

void Assembly::note_settled() {
  if (settled_bytes_ == 0 && now_s() >= kSettledAfterS) settled_bytes_ = resident_bytes();
}

/// Shows progress, and the force where no motor renders it.
void Assembly::show_going_on(ProgressBar& progress) {
  if (device_.has_motors()) return progress.report(settings_.label, now_s() / settings_.seconds);
  // A bar with a changing label has no fixed length, so the seconds follow it.
  progress.report(fmt::format("{}  {}", settings_.label, force_in_words(watch_.sent_n(), force_full_n_)),
                  -1.0);
}

void Assembly::poll_keys(SessionTasks& tasks, double until_s, device::ServoThread& thread,
                         ProgressBar& progress) {
  Keys keys;
  while (thread.running() && now_s() < until_s && !stopping_.load(std::memory_order_acquire)) {
    std::this_thread::sleep_for(kLookEvery);
    note_settled();
    prompt();
    show_reports(progress);
    show_going_on(progress);
    while (const std::optional<char> key = keys.next()) {
      if (*key == 'q')
        request_stop();
      else if (*key == 'r')
        (void)request_rearm();
      else
        tasks.key(*key);
    }
  }
}

Result<SessionEnd> Assembly::run_real(SessionTasks& tasks, ProgressBar& progress) {
  device::ServoThreadOptions options;
  options.rate_hz = std::llround(settings_.rate_hz);
  options.free_mm = settings_.free_mm;
  PALPATE_ASSIGN(std::unique_ptr<device::ServoThread> thread,
                 device::ServoThread::create(servo_, clock_.machine_clock(), options, observers_));
  watch_.rearms_by(*thread);
  servo_.watched_by(&device_.heart());
  device::Watchdog watchdog(device_.device(), device_.heart());
  PALPATE_TRY(watchdog.start());
  begun_ns_ = clock_.clock().now_ns();
  force_full_n_ = device_.device().limits().force_max_n;
  PALPATE_TRY(thread->start());
  begun_ns_ = clock_.clock().now_ns();  // opening time does not count
  note_scheduling(thread->mode().text());
  {
    const PollingThread worker([&] { work(tasks, now_s()); });
    poll_keys(tasks, settings_.seconds, *thread, progress);
    tasks.ending();
    // Stops the force before waiting for the worker, which may be preparing a renderer.
    thread->stop();
    watchdog.stop();
    let_go_.store(true, std::memory_order_release);
  }
  servo_.watched_by(nullptr);
  SessionEnd end = ended(thread->histograms());
  end.scheduling = thread->mode().text();
  end.notes = thread->mode().not_obtained;
  end.steal_percent = thread->steal_percent();
  end.watchdog_trips = watchdog.trips();
  return end;
}

}  // namespace palpate::experiments
