// Normal, beta and binomial distributions for trial statistics. Pure functions, thread-safe; the special
// functions are Boost.Math's.
#pragma once

#include <cstdint>

#include "toolkit/core/bootstrap_interval.h"

namespace palpate::experiments::psychophysics {

/// Phi(z) and its inverse; p in (0, 1).
[[nodiscard]] double normal_cdf(double z) noexcept;
[[nodiscard]] double normal_quantile(double p) noexcept;

/// Regularised incomplete beta I_x(a, b); a, b > 0, x in [0, 1].
[[nodiscard]] double beta_cdf(double x, double a, double b) noexcept;

/// P(X >= k) and P(X <= k) for X binomial with n trials of probability p. Exact to rounding.
[[nodiscard]] double binomial_at_least(std::uint64_t n, std::uint64_t k, double p) noexcept;
[[nodiscard]] double binomial_at_most(std::uint64_t n, std::uint64_t k, double p) noexcept;

/// At most 5 in 100 intervals miss the true value.
inline constexpr double kUsualAlpha = 0.05;

/// The exact Clopper-Pearson interval (1934) of a share k of n; (0, 1) if n is 0. Covers the true share in at
/// least 1 - alpha of all experiments.
[[nodiscard]] Interval clopper_pearson(std::uint64_t n, std::uint64_t k, double alpha = kUsualAlpha) noexcept;

}  // namespace palpate::experiments::psychophysics
