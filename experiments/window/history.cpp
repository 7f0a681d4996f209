#include "experiments/window/history.h"

#include <algorithm>
#include <cmath>

namespace palpate::experiments {

void FrameTimeHistogram::add(double us) noexcept {
  if (!(us > 0.0)) return;
  const double at = 2.0 * std::log2(us / kFirstUs);
  const double last = static_cast<double>(kBins - 1);
  ++count[static_cast<std::size_t>(std::clamp(at, 0.0, last))];
}

double FrameTimeHistogram::low_us(std::size_t bin) noexcept {
  return kFirstUs * std::exp2(0.5 * static_cast<double>(bin));
}

std::uint64_t FrameTimeHistogram::most() const noexcept {
  return *std::max_element(count.begin(), count.end());
}

void History::clear() {
  samples_.clear();
  frame_times_ = {};
}

void History::take(SampleRing& ring) {
  fresh_.clear();
  ring.drain(fresh_);
  for (const TickSample& one : fresh_) {
    samples_.push_back(one);
    frame_times_.add(static_cast<double>(one.step_us));
  }
  while (!samples_.empty() && samples_.front().t_s < samples_.back().t_s - kSeconds) samples_.pop_front();
}

double History::worst_step_us() const noexcept {
  float worst = 0.0f;
  for (const TickSample& one : samples_) worst = std::max(worst, one.step_us);
  return static_cast<double>(worst);
}

double History::mean_step_us() const noexcept {
  double sum = 0.0;
  std::size_t count = 0;
  for (const TickSample& one : samples_) {
    if (!(one.step_us > 0.0f)) continue;
    sum += static_cast<double>(one.step_us);
    ++count;
  }
  return count > 0 ? sum / static_cast<double>(count) : 0.0;
}

}  // namespace palpate::experiments
