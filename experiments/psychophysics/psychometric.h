// The psychometric function of a task with two answers: the share of right answers by the size of a
// difference, its fit by maximum likelihood, and the interval of its threshold by a seeded bootstrap.
//
//   share(x) = 1/2 + (1/2 - lapse) F(x / jnd),   F(0) = 0, F(1) = 1/2
//
// so without lapses three of four answers are right at the JND. Source: Wichmann and Hill, The psychometric
// function I and II, Perception & Psychophysics 63 (2001). Pure functions, thread-safe.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "experiments/psychophysics/detection.h"
#include "toolkit/core/bootstrap.h"
#include "toolkit/core/random.h"

namespace palpate::experiments::psychophysics {

enum class Shape : std::uint8_t {
  kDprime,  ///< d' grows as a power of the difference: F follows from the task
  kWeibull  ///< F(u) = 1 - 2^(-u^slope) (Weibull 1951, with the threshold at one half)
};
[[nodiscard]] const char* name_of(Shape shape) noexcept;

inline constexpr double kUsualSlope = 1.0;   ///< of kDprime: sensation grows as the difference does
inline constexpr double kUsualLapse = 0.02;  ///< one answer in fifty is a slip (Wichmann and Hill: 0 to 0.06)

struct Psychometric {
  Task task = Task::kTwoInterval;  ///< kTwoInterval or kAbx: those whose guesses are right half the time
  Shape shape = Shape::kDprime;
  double jnd = 1.0;  ///< unit of the differences, above 0
  double slope = kUsualSlope;
  double lapse = 0.0;
  /// Share of right answers at a difference x >= 0.
  [[nodiscard]] double proportion(double x) const noexcept;
};
/// d' at three right answers of four: 0.954 in a two-interval choice, 2.02 in ABX (differencing).
[[nodiscard]] double dprime_at_jnd(Task task) noexcept;

/// Answers at one difference.
struct LevelAnswers {
  double level = 0.0;
  std::uint64_t correct = 0, trials = 0;
};

struct PsychometricFit {
  Psychometric function;
  double log_likelihood = 0.0;
  double deviance = 0.0;  ///< against one share for each level
  bool at_edge = false;   ///< the threshold lies at the end of what was looked at: the levels do not tell it
};

/// Greatest likelihood in JND, and in slope where `slope` is nothing; lapse, task and shape as given. JNDs
/// are looked for from a tenth of the smallest level to ten times the largest. Nothing without an answer at a
/// level above 0. O(levels) a step, some 300 steps.
[[nodiscard]] std::optional<PsychometricFit> fit_psychometric(std::span<const LevelAnswers> levels,
                                                              const Psychometric& like,
                                                              std::optional<double> slope);

/// Resamples of the interval: 20 lie beyond either end.
inline constexpr int kPsychometricResamples = 800;

/// Percentiles of JNDs of studies simulated from `fit` and fitted as it was, at the same levels with the same
/// numbers of trials (Wichmann and Hill II: the parametric bootstrap). The same seed, the same interval.
[[nodiscard]] Interval bootstrap_jnd(std::span<const LevelAnswers> levels, const PsychometricFit& fit,
                                     std::optional<double> slope, std::uint64_t seed,
                                     int resamples = kPsychometricResamples);
/// The 2.5th and 97.5th percentile, nearest rank; sorts.
[[nodiscard]] Interval percentiles(std::vector<double>& values);

}  // namespace palpate::experiments::psychophysics
