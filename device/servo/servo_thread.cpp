#include <palpate/device/servo_thread.h>

#include <cerrno>
#include <ctime>
#include <future>
#include <system_error>
#include <utility>

#include <palpate/result.h>

namespace palpate::device {
namespace {

constexpr std::int64_t kNsPerSecond = 1'000'000'000;
// Awake time before a tick: three times the 99 % overshoot of a sleep on a quiet machine, but never most of a
// period: 100 us at 4 kHz.
constexpr std::int64_t kSpinMostNs = 150'000;
constexpr std::int64_t kSpinShareDivisor = 5;  // 2 / 5 of a period
constexpr std::int64_t kSpinShare = 2;
// The kernel suspends real-time threads that use over 95 % of a second. Sleeping a tenth keeps twice that
// distance.
constexpr std::int64_t kSleepDivisor = 10;
// Fifty periods of the slowest servo, which stops between ticks: a stuck one is not waited for.
constexpr std::int64_t kStopWaitNs = 100'000'000;
constexpr std::int64_t kStopLookNs = 1'000'000;

timespec timespec_of(std::int64_t t_ns) noexcept {
  return {static_cast<std::time_t>(t_ns / kNsPerSecond), static_cast<long>(t_ns % kNsPerSecond)};
}

/// Sleeps until the machine's monotonic clock shows this, despite signals.
void sleep_until(std::int64_t monotonic) noexcept {
  const timespec until = timespec_of(monotonic);
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

/// Tells the processor that this is a spin loop.
void pause_a_little() noexcept {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

}  // namespace

Result<std::unique_ptr<ServoThread>> ServoThread::create(Servo& servo, const MonotonicClock& clock,
                                                         const ServoThreadOptions& options,
                                                         std::span<TickObserver* const> observers) {
  PALPATE_ASSIGN(std::unique_ptr<ServoLoop> loop,
                 ServoLoop::create(servo, clock, options.rate_hz, observers));
  return std::unique_ptr<ServoThread>(new ServoThread(servo, clock, options, std::move(loop)));
}

ServoThread::ServoThread(Servo& servo, const MonotonicClock& clock, const ServoThreadOptions& options,
                         std::unique_ptr<ServoLoop> loop) noexcept
    : servo_(servo), clock_(clock), options_(options), loop_(std::move(loop)) {}

Status ServoThread::start() {
  if (started_) return Error{"the servo thread was started before", "make another for another session"};
  started_ = true;
  process_ = std::make_unique<ProcessRealTime>(options_.scheduling, mode_);
  // The program may end only after the device is released. Registered before the servo's own callback, which,
  // being newer, runs first and removes the force at once.
  stop_callback_ = StopCallback([this]() -> std::string {
    request_stop();
    const std::int64_t until = monotonic_ns() + kStopWaitNs;
    while (running() && monotonic_ns() < until) sleep_until(monotonic_ns() + kStopLookNs);
    return running() ? "the servo did not end" : "";
  });
  if (Status opened = servo_.start(options_.free_mm); !opened) {
    servo_.stop();
    stop_callback_.drop();
    process_.reset();
    return opened;
  }
  running_.store(true, std::memory_order_release);
  std::promise<void> scheduled;
  std::future<void> ready = scheduled.get_future();
  try {
    thread_ = std::thread([this, scheduled = std::move(scheduled)]() mutable {
      enter_real_time(options_.scheduling, mode_);
      steal_at_start_ = steal_times(mode_.pinned_cpu);
      scheduled.set_value();
      run();
    });
  } catch (const std::system_error& failed) {
    servo_.stop();
    running_.store(false, std::memory_order_release);
    stop_callback_.drop();
    process_.reset();
    return Error{std::string("no thread for the servo: ") + failed.what(),
                 "raise the limit of processes (ulimit -u)"};
  }
  ready.wait();
  return Done{};
}

void ServoThread::stop() noexcept {
  if (!thread_.joinable()) return;
  request_stop();
  thread_.join();
  servo_.stop();
  steal_at_end_ = steal_times(mode_.pinned_cpu);
  stop_callback_.drop();
  process_.reset();
}

double ServoThread::steal_percent() const {
  if (!started_) return 0.0;
  return device::steal_percent(steal_at_start_,
                               steal_at_end_.total > 0 ? steal_at_end_ : steal_times(mode_.pinned_cpu));
}

/// Waits for the next due tick. A thread that slept too little skips a period.
void ServoThread::wait() noexcept {
  const std::int64_t period_ns = loop_->due().period_ns();
  std::int64_t due_ns = loop_->due().due_ns();
  const std::int64_t now_ns = clock_.now_ns();
  owed_ns_ += (now_ns - looked_ns_) / kSleepDivisor;
  if (owed_ns_ > period_ns) due_ns = (due_ns > now_ns ? due_ns : now_ns) + period_ns;
  std::int64_t spin_ns = 0;
  if (options_.spin && mode_.fifo) {
    spin_ns = period_ns * kSpinShare / kSpinShareDivisor;
    if (spin_ns > kSpinMostNs) spin_ns = kSpinMostNs;
    if (spin_ns > (due_ns - now_ns) / 2) spin_ns = (due_ns - now_ns) / 2;
  }
  looked_ns_ = now_ns;
  if (due_ns - spin_ns > now_ns) {
    sleep_until(clock_.start_ns() + due_ns - spin_ns);
    looked_ns_ = clock_.now_ns();
    owed_ns_ -= looked_ns_ - now_ns;
    if (owed_ns_ < 0) owed_ns_ = 0;
  }
  while (clock_.now_ns() < due_ns) pause_a_little();
}

void ServoThread::run() noexcept {
  loop_->begin();
  looked_ns_ = clock_.now_ns();
  while (!stopping_.load(std::memory_order_acquire)) {
    wait();
    if (stopping_.load(std::memory_order_acquire)) break;
    loop_->tick();
  }
  loop_->end();
  servo_.end();
  running_.store(false, std::memory_order_release);
}

}  // namespace palpate::device
