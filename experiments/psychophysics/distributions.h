// Distributions that statistics of trials need: normal, beta, binomial. Pure functions, thread-safe;
// the special functions are Boost.Math's.
#pragma once

#include <cstdint>

#include "toolkit/core/bootstrap.h"

namespace palpate::experiments::psychophysics {

/// Phi(z), its density, and its inverse; p in (0, 1).
[[nodiscard]] double normal_cdf(double z) noexcept;
[[nodiscard]] double normal_density(double z) noexcept;
[[nodiscard]] double normal_quantile(double p) noexcept;

/// Regularised incomplete beta I_x(a, b); a, b > 0, x in [0, 1].
[[nodiscard]] double beta_cdf(double x, double a, double b) noexcept;

/// P(X >= k) and P(X <= k) of X binomial with n trials of probability p. Exact to rounding.
[[nodiscard]] double binomial_at_least(std::uint64_t n, std::uint64_t k, double p) noexcept;
[[nodiscard]] double binomial_at_most(std::uint64_t n, std::uint64_t k, double p) noexcept;

/// Of 5 in 100 intervals at most the true value lies outside.
inline constexpr double kUsualAlpha = 0.05;

/// Clopper and Pearson's exact interval (1934) of a share of k in n; (0, 1) where n is 0. It covers the true
/// share in at least 1 - alpha of all experiments.
[[nodiscard]] Interval clopper_pearson(std::uint64_t n, std::uint64_t k, double alpha = kUsualAlpha) noexcept;

}  // namespace palpate::experiments::psychophysics
