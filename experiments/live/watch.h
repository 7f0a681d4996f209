// What is kept of a live session while it runs: an observer of every tick, of fixed memory.
#pragma once

#include <array>
#include <vector>

#include "device/live/mixer.h"
#include "device/servo/loop_histogram.h"
#include "device/servo/tick_observer.h"
#include "experiments/live/live.h"

namespace palpate::experiments {

/// Decisions that are kept; later ones are counted.
inline constexpr std::size_t kMostDecisions = 20'000;
/// Stretches of the picture: about as many as it has dots across.
inline constexpr std::size_t kLiveSamples = 1'200;

/// The servo's thread until that has ended, then anybody's. Allocates when it is made alone.
class LiveWatch final : public device::TickObserver {
 public:
  /// `stretch_s`: how long a stretch of the picture lasts. `stiffness_n_per_mm`: the largest of the session.
  LiveWatch(const device::Mixer& mixer, std::size_t lanes, double stretch_s, double stiffness_n_per_mm);
  void took(const device::Tick& tick) noexcept override;
  /// Into a document whose renderers stand in the order of lanes.
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
