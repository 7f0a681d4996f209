#include "experiments/psychophysics/machine.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <palpate/result.h>
#include "experiments/psychophysics/psychometric.h"

namespace palpate::experiments::psychophysics {
namespace {

/// The cue that differs most; the first of equals.
std::size_t widest(const CueScales& differences) {
  std::size_t at = 0;
  for (std::size_t c = 1; c < kCues; ++c)
    if (std::abs(differences[c]) > std::abs(differences[at])) at = c;
  return at;
}

CueScales spread(const std::vector<CueScales>& intervals) {
  CueScales widths{};
  for (std::size_t c = 0; c < kCues; ++c) {
    const auto [low, high] =
        std::minmax_element(intervals.begin(), intervals.end(),
                            [c](const CueScales& a, const CueScales& b) { return a[c] < b[c]; });
    widths[c] = (*high)[c] - (*low)[c];
  }
  return widths;
}

}  // namespace

std::span<const FeltSample> samples_of(const FeltTrial& felt, std::uint32_t interval) noexcept {
  const auto is = [interval](const FeltSample& one) { return one.interval == interval; };
  const auto first = std::find_if(felt.samples.begin(), felt.samples.end(), is);
  const auto last = std::find_if_not(first, felt.samples.end(), is);
  return {first, last};
}

std::vector<CueScales> Machine::scales(const FeltTrial& felt) const {
  std::vector<CueScales> all;
  for (std::uint32_t i = 1; i <= intervals_of(plan_.task); ++i)
    all.push_back(
        scales_of(cues_of(samples_of(felt, i), spec_.thresholds), spec_.thresholds, way_a_, way_b_));
  return all;
}

Status Machine::learn(ProgressBar& progress) {
  // Uses the easiest pair; in a comparison, the two renderers themselves.
  Trial pair;
  pair.level = easiest_level(plan_);
  pair.shown = "AB";
  PALPATE_ASSIGN(const FeltTrial felt,
                 feel_alone(bench_, device_, bench_.passes(pair), pair.level, progress));
  const Cues a = cues_of(samples_of(felt, 1), spec_.thresholds),
             b = cues_of(samples_of(felt, 2), spec_.thresholds);
  if (!a.touched && !b.touched)
    return Error{"the simulated hand touches nothing of this scene",
                 "take another hand (machine:hand=explore), or press deeper (machine:depth=6)", plan_.name};
  way_a_ = a.direction;
  way_b_ = b.direction;
  of_a_ = scales_of(a, spec_.thresholds, way_a_, way_b_);
  const CueScales of_b = scales_of(b, spec_.thresholds, way_a_, way_b_);
  for (std::size_t c = 0; c < kCues; ++c) apart_[c] = of_b[c] - of_a_[c];
  return Done{};
}

/// Each interval's strength in sensation deviations from A, positive towards B.
std::vector<double> Machine::strengths(const std::vector<CueScales>& intervals) const {
  // A single interval is judged by the cue that best separated the pair.
  const std::size_t cue = widest(intervals.size() > 1 ? spread(intervals) : apart_);
  const double unit = dprime_at_jnd(Task::kTwoInterval), way = apart_[cue] < 0.0 ? -1.0 : 1.0;
  std::vector<double> all;
  for (const CueScales& one : intervals) all.push_back(unit * way * (one[cue] - of_a_[cue]));
  return all;
}

Result<std::vector<double>> Machine::feel(const Trial& trial, FeltTrial& felt, ProgressBar& progress) {
  PALPATE_ASSIGN(felt, feel_alone(bench_, device_, bench_.passes(trial), trial.level, progress));
  return strengths(scales(felt));
}

Result<Answer> Machine::answer(const Trial& trial, FeltTrial& felt, ProgressBar& progress) {
  PALPATE_ASSIGN(std::vector<double> sensed, feel(trial, felt, progress));
  ObserverOptions deciding = spec_.options;
  deciding.dprime = dprime_at_jnd(Task::kTwoInterval) * std::abs(apart_[widest(apart_)]);
  Answer answer = answer_of(deciding, {plan_.task, trial.number, std::move(sensed)}, answer_seed(plan_));
  answer.missed_deadlines = felt.missed_deadlines;
  answer.clipped_frames = felt.clipped_frames;
  return answer;
}

}  // namespace palpate::experiments::psychophysics
