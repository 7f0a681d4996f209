// Observers that answer trials; simulated ones of known sensitivity test the estimators.
//
// An observer gets sensations only, nothing that names the renderer or option. A trial's randomness depends
// on the study's seed and the trial's number, so an interrupted study continues identically.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <palpate/result.h>
#include "experiments/psychophysics/cues.h"
#include "experiments/psychophysics/detection.h"
#include "experiments/psychophysics/psychometric.h"

namespace palpate::experiments::psychophysics {

/// An observer's input in a trial: each interval's difference from the standard, in sensation deviations.
/// Blind: no names, no settings.
struct Felt {
  Task task = Task::kAbx;
  std::uint64_t trial = 0;
  std::vector<double> strengths;
};

struct Answer {
  int choice = 0;        ///< 0: first, same, standard; 1: second, different, other
  int confidence = 1;    ///< 1 guessed .. 4 sure; 0: not asked for
  double seconds = 0.0;  ///< response time
  std::uint64_t missed_deadlines = 0, clipped_frames = 0;  ///< of the servo, during the trial
};

/// Decision parameters of an observer; strengths are in sensation deviations.
struct ObserverOptions {
  double dprime = 1.0;  ///< between the two renderers
  double jnd = 0.0;     ///< an option's, in its unit
  double slope = kUsualSlope;
  double lapse = 0.0;      ///< share of random answers
  double bias = 0.0;       ///< added to the criterion
  double criterion = 1.5;  ///< same-different: the difference called one
  double catch_dprime = 5.0;
  double missed = 0.0;  ///< share of trials with a missed deadline
  Strategy strategy = Strategy::kDifferencing;
};

enum class ObserverKind : std::uint8_t {
  kSimulated,  ///< answers from parameters; no renderer runs
  kMachine,    ///< published thresholds applied to a simulated hand's forces
  kPerson      ///< answers by keys
};

/// Parsed from "simulated:dprime=1", "simulated:jnd=0.05:slope=1:lapse=0.02:..",
/// "machine:hand=slide:stiffness=0.1" or "person". Errors name the option and its range.
struct ObserverSpec {
  std::string text;
  ObserverKind kind = ObserverKind::kSimulated;
  ObserverOptions options;
  bool has_jnd = false;
  // For a machine, and for a simulated hand watched by a person.
  Thresholds thresholds;
  std::string hand = "press";
  double depth_mm = 4.0;
};
[[nodiscard]] Result<ObserverSpec> parse_observer(const std::string& text);

/// The answer to trial `felt.trial` under `seed`. A pure function.
[[nodiscard]] Answer answer_of(const ObserverOptions& observer, const Felt& felt, std::uint64_t seed);

/// d' of an option's difference: dprime_at_jnd(task) * (difference / jnd)^slope.
[[nodiscard]] double dprime_of_difference(const ObserverOptions& observer, Task task,
                                          double difference) noexcept;

}  // namespace palpate::experiments::psychophysics
