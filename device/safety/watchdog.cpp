#include <palpate/device/watchdog.h>

#include <pthread.h>
#include <sched.h>
#include <time.h>

#include <cmath>

#include <palpate/clock.h>

namespace palpate::device {
namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;

std::int64_t watchdog_ns(double seconds) noexcept {
  return std::llround(seconds * static_cast<double>(kNsPerS));
}

}  // namespace

Watchdog::Watchdog(Device& device, Heartbeat& heart, const WatchdogOptions& options) noexcept
    : device_(device),
      heart_(heart),
      options_(options),
      limit_ns_(watchdog_ns(options.limit_s)),
      every_ns_(watchdog_ns(options.every_s)),
      detector_(limit_ns_) {}

Status Watchdog::start() {
  constexpr double kMaxS = 1.0;  // a force held for longer helps nobody
  if (!(options_.every_s > 0.0) || !(options_.limit_s > 2.0 * options_.every_s) || options_.limit_s > kMaxS)
    return Error{"the watchdog looks every " + std::to_string(options_.every_s) + " s for a limit of " +
                     std::to_string(options_.limit_s) + " s",
                 "give a limit of 1 s or less, and looks more than twice as often"};
  stop();
  ending_.store(false);
  thread_ = std::thread([this] { run(); });
  return Done{};
}

void Watchdog::stop() noexcept {
  if (!thread_.joinable()) return;
  ending_.store(true);
  thread_.join();
  // Nobody watches from here on.
  if (heart_.expected()) device_.cut_force();
}

void Watchdog::look(std::int64_t now_ns) noexcept {
  const bool late = last_look_ns_ >= 0 && now_ns - last_look_ns_ > limit_ns_ / 2;
  const std::uint64_t count = heart_.count();
  const bool still = heart_.expected() && count == last_count_;
  last_look_ns_ = now_ns;
  last_count_ = count;
  if (late) {
    late_looks_.fetch_add(1, std::memory_order_relaxed);
    detector_.restart();
    if (still) device_.cut_force();
  }
  if (detector_.stalled(heart_, now_ns) && !heart_.tripped()) {
    tripped_ns_.store(now_ns, std::memory_order_relaxed);
    heart_.trip();
    trips_.fetch_add(1, std::memory_order_relaxed);
  }
  if (heart_.tripped()) device_.cut_force();
}

void Watchdog::run() noexcept {
  sched_param priority{};
  priority.sched_priority = kPriority;
  real_time_.store(::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &priority) == 0);
  std::int64_t next_ns = monotonic_ns();
  while (!ending_.load()) {
    const std::int64_t now_ns = monotonic_ns();
    look(now_ns);
    next_ns += every_ns_;
    if (next_ns < now_ns) next_ns = now_ns + every_ns_;  // skipped, not caught up
    const timespec until{static_cast<time_t>(next_ns / kNsPerS), static_cast<long>(next_ns % kNsPerS)};
    ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
  }
}

}  // namespace palpate::device
