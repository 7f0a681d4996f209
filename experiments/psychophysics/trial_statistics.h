// Statistics of numbers of right answers: normal, beta and binomial distributions (the special functions are
// Boost.Math's), and the numbers of trials that a study needs, for an exact one-sided binomial test against
// chance and an equivalence test. The second is needed because a missed difference proves nothing.
//
// An exact test's power is a sawtooth of the number of trials, so two numbers are given: the first that
// reaches the power, and the one from which all do. Pure functions, thread-safe.
#pragma once

#include <cstdint>
#include <optional>

#include "toolkit/core/statistics.h"

namespace palpate::experiments::psychophysics {

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
