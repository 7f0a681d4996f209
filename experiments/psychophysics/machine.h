// The machine observer: a simulated hand feels the renderers of a plan, and thresholds of the literature say
// what a person would notice of it. Predictions, to be registered before people are asked.
//
// Beforehand it feels the pair of catch and practice trials once, as practice shows people what is asked for:
// from that it knows which way each cue goes. In a trial the cue that tells the intervals apart most decides,
// by its scale of just noticeable differences (cues.h): one is a d' of 0.954, so that 75 of 100 two-interval
// choices are right there. Then it answers as a simulated observer does, with internal noise, criterion and
// lapses of its own.
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

  /// Feels the pair that nobody misses. Before the first answer.
  [[nodiscard]] Status learn(ProgressBar& progress);
  /// The strength of each interval's sensation, in its deviations, counted from A of the pair towards B;
  /// without noise.
  [[nodiscard]] Result<std::vector<double>> feel(const Trial& trial, FeltTrial& felt, ProgressBar& progress);
  /// What it felt is left in `felt`. Depends on plan, device and trial alone, not on the trials before.
  [[nodiscard]] Result<Answer> answer(const Trial& trial, FeltTrial& felt, ProgressBar& progress);

  /// Of the pair: each cue's difference in just noticeable ones.
  [[nodiscard]] const CueScales& apart() const noexcept { return apart_; }

 private:
  [[nodiscard]] std::vector<CueScales> scales(const FeltTrial& felt) const;
  [[nodiscard]] std::vector<double> strengths(const std::vector<CueScales>& intervals) const;

  const Plan& plan_;
  const ObserverSpec& spec_;
  Bench& bench_;
  const DeviceChoice& device_;
  Vec3 way_a_ = Vec3::Zero(), way_b_ = Vec3::Zero();  ///< of the forces of the pair
  CueScales of_a_{}, apart_{};
};

/// The samples of one interval, in order.
[[nodiscard]] std::span<const FeltSample> samples_of(const FeltTrial& felt, std::uint32_t interval) noexcept;

}  // namespace palpate::experiments::psychophysics
