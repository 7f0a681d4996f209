// Observes every tick of a live session in fixed memory.
#pragma once

#include <array>
#include <vector>

#include <palpate/device/loop_histogram.h>
#include <palpate/device/servo.h>
#include "device/live/mixer.h"
#include "experiments/live/live.h"

namespace palpate::experiments {

/// Decisions kept; later ones are only counted.
inline constexpr std::size_t kMostDecisions = 20'000;
/// Stretches of the chart: about its width in dots.
inline constexpr std::size_t kLiveSamples = 1'200;

/// For the servo's thread until that ends, then for any. Allocates in its constructor only.
class LiveWatch final : public device::TickObserver {
 public:
  /// `stretch_s`: length of a stretch of the chart. `stiffness_n_per_mm`: the session's largest.
  LiveWatch(const device::Mixer& mixer, std::size_t lanes, double stretch_s, double stiffness_n_per_mm);
  void took(const device::Tick& tick) noexcept override;
  /// Writes into a document whose renderers are in lane order.
  void tell(LiveDocument& document) const;

 private:
  struct Lane {
    device::DurationHistogram step;
    std::uint64_t frames = 0, contact_frames = 0, felt_frames = 0;
    double largest_step_n = 0.0;
    metrics::ForceSteps felt_steps;
    Vec3 last_n = Vec3::Zero();
    std::uint32_t generation = 0, made = 1;
    device::Disqualified disqualified = device::Disqualified::kNo;
    bool known = false;
  };
  void watch_lanes(const device::Tick& tick, const device::MixedFrame& now) noexcept;
  void watch_steps(const device::MixedFrame& now) noexcept;
  void note_decision(const device::Tick& tick, const device::MixedFrame& now) noexcept;
  void sample(const device::Tick& tick, const device::MixedFrame& now) noexcept;

  const device::Mixer& mixer_;
  std::vector<Lane> lanes_;
  double stretch_s_;
  device::MixedFrame before_;
  bool has_before_ = false;
  bool faulted_ = false;
  device::SwitchSource source_ = device::SwitchSource::kProgram;
  double begun_s_ = 0.0;
  bool begun_ = false;
  std::uint64_t ticks_ = 0, faults_ = 0, rearmed_ = 0, half_rate_ = 0;
  std::uint64_t switches_ = 0, fades_ = 0, refused_ = 0, waited_ = 0, decisions_lost_ = 0;
  double largest_step_n_ = 0.0, largest_excess_n_ = 0.0;
  std::array<bool, 32> fault_seen_{};
  std::vector<LiveDecision> decisions_;
  std::vector<LiveSample> samples_;
  std::size_t sample_ = 0, in_sample_ = 0;
};

}  // namespace palpate::experiments
