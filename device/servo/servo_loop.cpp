#include "device/servo/servo_loop.h"

#include <algorithm>
#include <string>

namespace palpate::device {
namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;

}  // namespace

// In whole seconds and the rest, so that nothing overflows in any session.
std::int64_t DueTimes::at(std::int64_t tick) const noexcept {
  return first_ns_ + tick / rate_hz_ * kNsPerS + tick % rate_hz_ * kNsPerS / rate_hz_;
}

std::int64_t DueTimes::period_ns() const noexcept {
  return kNsPerS / rate_hz_;
}

std::uint64_t DueTimes::take(std::int64_t now_ns) noexcept {
  const std::int64_t due = next_++;
  const std::int64_t elapsed_ns = now_ns - first_ns_;
  if (now_ns < at(next_)) return 0;
  // The last tick due by now: the largest k with floor(k 10^9 / rate) <= elapsed, so k 10^9 / rate < elapsed
  // + 1.
  const std::int64_t rest_ns = elapsed_ns % kNsPerS;
  const std::int64_t last =
      elapsed_ns / kNsPerS * rate_hz_ + ((rest_ns + 1) * rate_hz_ + kNsPerS - 1) / kNsPerS - 1;
  next_ = last + 1;
  return static_cast<std::uint64_t>(last - due);
}

Result<std::unique_ptr<ServoLoop>> ServoLoop::create(Servo& servo, const Clock& clock, std::int64_t rate_hz,
                                                     std::span<TickObserver* const> observers) {
  if (rate_hz < kLeastServoHz || rate_hz > kMostServoHz)
    return Error{"the servo's rate is " + std::to_string(rate_hz) + " Hz",
                 "give " + std::to_string(kLeastServoHz) + " to " + std::to_string(kMostServoHz) + " Hz", "",
                 0};
  if (observers.size() > kMostObservers)
    return Error{"the servo has " + std::to_string(observers.size()) + " observers",
                 "give at most " + std::to_string(kMostObservers), "", 0};
  return std::unique_ptr<ServoLoop>(new ServoLoop(servo, clock, rate_hz, observers));
}

ServoLoop::ServoLoop(Servo& servo, const Clock& clock, std::int64_t rate_hz,
                     std::span<TickObserver* const> observers) noexcept
    : servo_(servo), clock_(clock), due_(rate_hz), observers_count_(observers.size()) {
  std::copy(observers.begin(), observers.end(), observers_.begin());
}

void ServoLoop::count(const Tick& tick, std::int64_t began_ns) noexcept {
  histograms_.lateness.count(began_ns - tick.due_ns);
  if (tick.missed > 0) histograms_.miss(tick.missed);
  histograms_.exchange.count(tick.exchange_ns);
  if (has_before_) histograms_.period.count(began_ns - before_ns_);
  before_ns_ = began_ns;
  // What a restart took is neither a frame's time nor a period's.
  has_before_ = !tick.restarted;
  if (tick.step_ns > 0 && !tick.restarted) histograms_.step.count(tick.step_ns);
}

Tick ServoLoop::tick() noexcept {
  const std::int64_t began_ns = clock_.now_ns();
  const std::int64_t due_ns = due_.due_ns();
  const std::uint64_t missed = due_.take(began_ns);
  if (rearm_.load(std::memory_order_relaxed) && rearm_.exchange(false, std::memory_order_acquire))
    servo_.rearm();
  Tick tick = servo_.tick();
  tick.due_ns = due_ns;
  tick.missed = missed;
  count(tick, began_ns);
  for (std::size_t i = 0; i < observers_count_; ++i) observers_[i]->took(tick);
  const std::int64_t ended_ns = clock_.now_ns();
  if (tick.restarted)
    due_.begin(ended_ns + due_.period_ns());
  else if (ended_ns - began_ns > due_.period_ns())
    histograms_.overrun();
  return tick;
}

}  // namespace palpate::device
