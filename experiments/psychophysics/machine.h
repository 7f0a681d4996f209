// The machine observer, which predicts answers. It takes a simulated hand's forces and published thresholds.
// Predictions can be registered before people are asked.
//
// It first feels the pair of catch and practice trials once, as people do in practice, to learn each cue's
// direction. In a trial the cue that separates the intervals most decides, on its scale of just noticeable
// differences (cues.h): one is a d' of 0.954, so 75 of 100 two-interval choices are right there. Its internal
// noise, criterion and lapses are those of a simulated observer.
#pragma once

#include <vector>

#include "experiments/psychophysics/observers.h"
#include "experiments/psychophysics/rig.h"

namespace palpate::experiments::psychophysics {

/// Refers to everything. One thread.
class Machine {
 public:
  Machine(const Plan& plan, const ObserverSpec& spec, Bench& bench, const DeviceChoice& device)
      : plan_(plan), spec_(spec), bench_(bench), device_(device) {}

  /// Feels the easiest pair. Call before the first answer.
  [[nodiscard]] Status learn(ProgressBar& progress);
  /// Each interval's strength in sensation deviations, from the pair's A towards B; without noise.
  [[nodiscard]] Result<std::vector<double>> feel(const Trial& trial, FeltTrial& felt, ProgressBar& progress);
  /// Answers a trial and leaves its samples in `felt`. Depends on plan, device and trial only, not on earlier
  /// trials.
  [[nodiscard]] Result<Answer> answer(const Trial& trial, FeltTrial& felt, ProgressBar& progress);

  /// Each cue's difference over the pair, in just noticeable differences.
  [[nodiscard]] const CueScales& apart() const noexcept { return apart_; }

 private:
  [[nodiscard]] std::vector<CueScales> scales(const FeltTrial& felt) const;
  [[nodiscard]] std::vector<double> strengths(const std::vector<CueScales>& intervals) const;

  const Plan& plan_;
  const ObserverSpec& spec_;
  Bench& bench_;
  const DeviceChoice& device_;
  Vec3 way_a_ = Vec3::Zero(), way_b_ = Vec3::Zero();  ///< directions of the pair's forces
  CueScales of_a_{}, apart_{};
};

/// Samples of one interval, in order.
[[nodiscard]] std::span<const FeltSample> samples_of(const FeltTrial& felt, std::uint32_t interval) noexcept;

}  // namespace palpate::experiments::psychophysics
