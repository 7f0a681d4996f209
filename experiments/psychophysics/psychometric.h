// The psychometric function of a two-answer task: share of right answers by size of difference. Fitted by
// maximum likelihood, with a seeded bootstrap interval of its threshold.
//
//   share(x) = 1/2 + (1/2 - lapse) F(x / jnd),   F(0) = 0, F(1) = 1/2
//
// Without lapses three of four answers are right at the JND. Source: Wichmann and Hill, The psychometric
// function I and II, Perception & Psychophysics 63 (2001). Pure functions, thread-safe.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "experiments/psychophysics/detection.h"
#include "toolkit/core/random.h"
#include "toolkit/core/statistics.h"

namespace palpate::experiments::psychophysics {

enum class Shape : std::uint8_t {
  kDprime,  ///< d' grows as a power of the difference; F depends on the task
  kWeibull  ///< F(u) = 1 - 2^(-u^slope) (Weibull 1951, threshold at one half)
};
[[nodiscard]] const char* name_of(Shape shape) noexcept;

inline constexpr double kUsualSlope = 1.0;  ///< kDprime: sensation proportional to the difference

struct Psychometric {
  Task task = Task::kTwoInterval;  ///< kTwoInterval or kAbx: guesses are right half the time
  Shape shape = Shape::kDprime;
  double jnd = 1.0;  ///< in the differences' unit, above 0
  double slope = kUsualSlope;
  double lapse = 0.0;
  /// Share of right answers at a difference x >= 0.
  [[nodiscard]] double proportion(double x) const noexcept;
};
/// d' at three right answers in four: 0.954 in a two-interval choice, 2.02 in ABX (differencing).
[[nodiscard]] double dprime_at_jnd(Task task) noexcept;

/// Answers at one difference.
struct LevelAnswers {
  double level = 0.0;
  std::uint64_t correct = 0, trials = 0;
};

struct PsychometricFit {
  Psychometric function;
  double log_likelihood = 0.0;
  double deviance = 0.0;  ///< against one share per level
  bool at_edge = false;   ///< the JND is at the search bound: the levels do not determine it
};

/// Maximum likelihood fit of JND, and of slope if `slope` is empty, with given lapse, task and shape.
/// Searches JNDs from a tenth of the smallest to ten times the largest level. Empty without an answer at a
/// level above 0. O(levels) per step, some 300 steps.
[[nodiscard]] std::optional<PsychometricFit> fit_psychometric(std::span<const LevelAnswers> levels,
                                                              const Psychometric& like,
                                                              std::optional<double> slope);

/// Resamples of the interval: 20 lie beyond either end.
inline constexpr int kPsychometricResamples = 800;

/// Parametric bootstrap interval (Wichmann and Hill II): percentiles of JNDs of studies simulated from `fit`
/// at the same levels and numbers of trials, fitted alike. Deterministic in the seed.
[[nodiscard]] Interval bootstrap_jnd(std::span<const LevelAnswers> levels, const PsychometricFit& fit,
                                     std::optional<double> slope, std::uint64_t seed,
                                     int resamples = kPsychometricResamples);
/// The 2.5th and 97.5th percentiles, nearest rank; sorts.
[[nodiscard]] Interval percentiles(std::vector<double>& values);

// Statistics of numbers of right answers: normal, beta and binomial distributions (the special functions are
// Boost.Math's), and the numbers of trials that a study needs, for an exact one-sided binomial test against
// chance and an equivalence test. The second is needed because a missed difference proves nothing.
//
// An exact test's power is a sawtooth of the number of trials, so two numbers are given: the first that
// reaches the power, and the one from which all do. Pure functions, thread-safe.

/// Phi(z) and its inverse; p in (0, 1).
[[nodiscard]] double normal_cdf(double z) noexcept;
[[nodiscard]] double normal_quantile(double p) noexcept;

/// P(X >= k) and P(X <= k) for X binomial with n trials of probability p. Exact to rounding.
[[nodiscard]] double binomial_at_least(std::uint64_t n, std::uint64_t k, double p) noexcept;
[[nodiscard]] double binomial_at_most(std::uint64_t n, std::uint64_t k, double p) noexcept;

/// At most 5 in 100 intervals miss the true value.
inline constexpr double kUsualAlpha = 0.05;

/// The exact Clopper-Pearson interval (1934) of a share k of n; (0, 1) if n is 0. Covers the true share in at
/// least 95 % of all experiments.
[[nodiscard]] Interval clopper_pearson(std::uint64_t n, std::uint64_t k) noexcept;

inline constexpr double kUsualPower = 0.8;
/// Probability of guessing one of two answers.
inline constexpr double kChance = 0.5;
/// Most trials searched; more than anybody sits through.
inline constexpr std::uint64_t kMostTrials = 20'000;

struct Needed {
  std::uint64_t first = 0;  ///< the smallest sufficient number
  std::uint64_t safe = 0;   ///< this and every larger number suffice
};

/// P-values: at least this many hits by chance; at most this many if the share of right answers is `bound`.
[[nodiscard]] double difference_p(std::uint64_t trials, std::uint64_t correct) noexcept;
[[nodiscard]] double equivalence_p(std::uint64_t trials, std::uint64_t correct, double bound) noexcept;

/// Probability that a share `p` of right answers is found above chance.
[[nodiscard]] double difference_power(std::uint64_t trials, double p, double alpha) noexcept;
/// Probability that pure guessing is found below `bound`.
[[nodiscard]] double equivalence_power(std::uint64_t trials, double bound, double alpha) noexcept;

/// Empty if kMostTrials do not suffice or the share is not above chance.
[[nodiscard]] std::optional<Needed> trials_for_difference(double p, double power, double alpha);
[[nodiscard]] std::optional<Needed> trials_for_equivalence(double bound, double power, double alpha);

/// The smallest share, to 0.001, that this many trials of guessing exclude at this power. Empty if not even
/// 0.999 is excluded.
[[nodiscard]] std::optional<double> shown_bound(std::uint64_t trials, double power, double alpha);

}  // namespace palpate::experiments::psychophysics
