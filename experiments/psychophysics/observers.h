// Observers that answer trials: simulated ones of known sensitivity, on whom every estimator is tested.
//
// An observer gets what was felt, and nothing that says which renderer or option it was. All randomness of a
// trial comes from the study's seed and the trial's number, so that a study that is taken up again goes on as
// if it had not stopped.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "experiments/psychophysics/cues.h"
#include "experiments/psychophysics/detection.h"
#include "experiments/psychophysics/psychometric.h"
#include "toolkit/core/result.h"

namespace palpate::experiments::psychophysics {

/// What reaches an observer in one trial: for each interval how strongly the two things differ from each
/// other there, in units of the sensation's deviation (0: the standard). Blind: no names, no settings.
struct Felt {
  Task task = Task::kAbx;
  std::uint64_t trial = 0;
  std::vector<double> strengths;
};

struct Answer {
  int choice = 0;        ///< 0: the first, the same, the standard; 1: the second, different, the other
  int confidence = 1;    ///< 1 guessed .. 4 sure; 0: not asked for
  double seconds = 0.0;  ///< that it took
  std::uint64_t missed_deadlines = 0, clipped_frames = 0;  ///< of the servo, while it was felt
};

/// How an observer decides; strengths are in units of the sensation's deviation.
struct ObserverOptions {
  double dprime = 1.0;  ///< between the two renderers
  double jnd = 0.0;     ///< of an option, in its unit
  double slope = kUsualSlope;
  double lapse = 0.0;      ///< share of answers that are thrown like a coin
  double bias = 0.0;       ///< added to the criterion
  double criterion = 1.5;  ///< of same-different: the difference that is called one
  double catch_dprime = 5.0;
  double missed = 0.0;  ///< share of trials with a missed deadline
  Strategy strategy = Strategy::kDifferencing;
};

enum class ObserverKind : std::uint8_t {
  kSimulated,  ///< answers from a number; no renderer runs
  kMachine,    ///< thresholds of the literature, on what a simulated hand feels
  kPerson      ///< keys
};

/// "simulated:dprime=1", "simulated:jnd=0.05:slope=1:lapse=0.02:..", "machine:hand=slide:stiffness=0.1",
/// "person". Errors name the option and its range.
struct ObserverSpec {
  std::string text;
  ObserverKind kind = ObserverKind::kSimulated;
  ObserverOptions options;
  bool has_dprime = false, has_jnd = false;
  // Of a machine, and of a simulated hand that a person watches.
  Thresholds thresholds;
  std::string hand = "press";
  double depth_mm = 4.0;
};
[[nodiscard]] Result<ObserverSpec> parse_observer(const std::string& text);

/// The answer of trial `felt.trial` under `seed`. A pure function.
[[nodiscard]] Answer answer_of(const ObserverOptions& observer, const Felt& felt, std::uint64_t seed);

/// d' of a difference of an option: dprime_at_jnd(task) * (difference / jnd)^slope.
[[nodiscard]] double dprime_of_difference(const ObserverOptions& observer, Task task,
                                          double difference) noexcept;

}  // namespace palpate::experiments::psychophysics
