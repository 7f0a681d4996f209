#include "experiments/window/feed.h"

#include <algorithm>
#include <utility>

namespace palpate::experiments {
namespace {

constexpr double kUsPerNs = 1e-3;

}  // namespace

void SampleRing::push(const TickSample& sample) noexcept {
  const std::uint64_t at = written_.load(std::memory_order_relaxed);
  // Acquire: the reader is done with the place that is written over.
  if (at - read_.load(std::memory_order_acquire) >= kSize) {
    lost_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  ring_[at % kSize] = sample;
  written_.store(at + 1, std::memory_order_release);
}

std::size_t SampleRing::drain(std::vector<TickSample>& into) {
  const std::uint64_t end = written_.load(std::memory_order_acquire);
  std::uint64_t at = read_.load(std::memory_order_relaxed);
  const auto count = static_cast<std::size_t>(end - at);
  for (; at < end; ++at) into.push_back(ring_[at % kSize]);
  read_.store(end, std::memory_order_release);
  return count;
}

WindowFeed::WindowFeed(const device::Servo& servo, const device::Mixer& mixer,
                       std::vector<std::shared_ptr<render::MovingModel>> moving)
    : servo_(servo), mixer_(mixer), moving_(std::move(moving)) {
  if (moving_.size() > kMostShownMotions) moving_.resize(kMostShownMotions);
}

void WindowFeed::took(const device::Tick& tick) noexcept {
  const std::uint64_t ticks = ticks_.load(std::memory_order_relaxed) + 1;
  WatchedTick& into = newest_.back();
  into.ticks = ticks;
  into.tick = tick;
  into.mixed = mixer_.last();
  into.map = servo_.map();
  for (std::size_t i = 0; i < moving_.size(); ++i)
    into.world_from_model[i] = moving_[i]->newest().at(tick.t_s);
  newest_.publish();
  TickSample sample;
  sample.t_s = tick.t_s;
  sample.sent_n = static_cast<float>(tick.sent_n.norm());
  sample.step_us = static_cast<float>(static_cast<double>(tick.step_ns) * kUsPerNs);
  if (tick.due_ns != 0)
    sample.late_us = static_cast<float>(
        static_cast<double>(std::max<std::int64_t>(0, tick.t_ns - tick.due_ns)) * kUsPerNs);
  sample.contact = tick.frame.contact;
  sample.fault = tick.fault != device::Fault::kNone;
  samples_.push(sample);
  ticks_.store(ticks, std::memory_order_release);
}

}  // namespace palpate::experiments
