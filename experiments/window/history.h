// A session's last seconds, for plots.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <vector>

#include "experiments/window/feed.h"

namespace palpate::experiments {

/// Frame-time bins by powers of the square root of 2 from 0.25 us; the last holds everything above 8 ms.
struct FrameTimeHistogram {
  static constexpr std::size_t kBins = 32;
  static constexpr double kFirstUs = 0.25;
  std::array<std::uint64_t, kBins> count{};

  void add(double us) noexcept;
  [[nodiscard]] static double low_us(std::size_t bin) noexcept;
  [[nodiscard]] std::uint64_t most() const noexcept;
};

/// Appends drained samples and drops those older than kSeconds. One thread.
class History {
 public:
  static constexpr double kSeconds = 10.0;

  void clear();
  void take(SampleRing& ring);
  [[nodiscard]] const std::deque<TickSample>& samples() const noexcept { return samples_; }
  [[nodiscard]] const FrameTimeHistogram& frame_times() const noexcept { return frame_times_; }
  /// Largest and mean frame time; 0 if empty.
  [[nodiscard]] double worst_step_us() const noexcept;
  [[nodiscard]] double mean_step_us() const noexcept;
  /// Per plot column the largest value in it; negative if none.
  template <class Of>
  [[nodiscard]] std::vector<float> columns(std::size_t count, Of&& of) const {
    std::vector<float> most(count, -1.0f);
    if (samples_.empty() || count == 0) return most;
    const double from_s = samples_.back().t_s - kSeconds;
    for (const TickSample& one : samples_) {
      const auto at = static_cast<std::size_t>((one.t_s - from_s) / kSeconds * static_cast<double>(count));
      float& into = most[at < count ? at : count - 1];
      const float value = of(one);
      if (value > into) into = value;
    }
    return most;
  }

 private:
  std::deque<TickSample> samples_;
  std::vector<TickSample> fresh_;
  FrameTimeHistogram frame_times_;
};

}  // namespace palpate::experiments
