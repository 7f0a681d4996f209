#include "experiments/psychophysics/trial_statistics.h"

#include <boost/math/special_functions/beta.hpp>
#include <boost/math/special_functions/erf.hpp>

#include <cmath>
#include <numbers>

namespace palpate::experiments::psychophysics {
namespace {

namespace math = boost::math;
/// Never throws: unrepresentable results become infinite or NaN.
using Quiet = math::policies::policy<math::policies::domain_error<math::policies::ignore_error>,
                                     math::policies::pole_error<math::policies::ignore_error>,
                                     math::policies::overflow_error<math::policies::ignore_error>,
                                     math::policies::evaluation_error<math::policies::ignore_error>>;

/// Regularised incomplete beta I_x(a, b); a, b > 0, x in [0, 1].
double beta_cdf(double x, double a, double b) noexcept {
  return math::ibeta(a, b, x, Quiet());
}

}  // namespace

double normal_cdf(double z) noexcept {
  return 0.5 * std::erfc(-z / std::numbers::sqrt2);
}

double normal_quantile(double p) noexcept {
  return -std::numbers::sqrt2 * math::erfc_inv(2.0 * p, Quiet());
}

double binomial_at_least(std::uint64_t n, std::uint64_t k, double p) noexcept {
  if (k == 0) return 1.0;
  if (k > n) return 0.0;
  return beta_cdf(p, static_cast<double>(k), static_cast<double>(n - k) + 1.0);
}

double binomial_at_most(std::uint64_t n, std::uint64_t k, double p) noexcept {
  if (k >= n) return 1.0;
  return beta_cdf(1.0 - p, static_cast<double>(n - k), static_cast<double>(k) + 1.0);
}

Interval clopper_pearson(std::uint64_t n, std::uint64_t k) noexcept {
  const auto hits = static_cast<double>(k), misses = static_cast<double>(n - k);
  Interval interval{0.0, 1.0};
  if (k > 0) interval.low = math::ibeta_inv(hits, misses + 1.0, 0.5 * kUsualAlpha, Quiet());
  if (k < n) interval.high = math::ibeta_inv(hits + 1.0, misses, 1.0 - 0.5 * kUsualAlpha, Quiet());
  return interval;
}

namespace {

// The power's sawtooth has teeth some 1/(p - 1/2) trials long, of heights that fall with the number of
// trials. Beyond 1.5 times the first sufficient number plus this many, none falls below the wanted power.
constexpr std::uint64_t kTeeth = 60;
constexpr double kThousandth = 0.001;
constexpr int kThousandths = 499;  // from 0.501 to 0.999

/// The most right answers that show less than `bound`; empty if none do.
std::optional<std::uint64_t> most_below(std::uint64_t trials, double bound, double alpha) noexcept {
  std::uint64_t low = 0, high = trials;
  if (binomial_at_most(trials, 0, bound) > alpha) return std::nullopt;
  while (low < high) {
    const std::uint64_t middle = low + (high - low + 1) / 2;
    if (binomial_at_most(trials, middle, bound) <= alpha)
      low = middle;
    else
      high = middle - 1;
  }
  return low;
}

template <class Power>
std::optional<Needed> needed(double power, Power&& power_of) {
  Needed found;
  for (std::uint64_t n = 1; n <= kMostTrials && found.first == 0; ++n)
    if (power_of(n) >= power) found.first = n;
  if (found.first == 0) return std::nullopt;
  found.safe = found.first;
  const std::uint64_t last = found.first + found.first / 2 + kTeeth;
  for (std::uint64_t n = found.first; n <= last; ++n)
    if (power_of(n) < power) found.safe = n + 1;
  return found;
}

/// Fewest right answers above chance at `alpha`; trials + 1 if none are.
std::uint64_t least_above_chance(std::uint64_t trials, double alpha) noexcept {
  std::uint64_t low = 0, high = trials + 1;
  while (low < high) {
    const std::uint64_t middle = low + (high - low) / 2;
    if (binomial_at_least(trials, middle, kChance) <= alpha)
      high = middle;
    else
      low = middle + 1;
  }
  return low;
}

}  // namespace

double difference_p(std::uint64_t trials, std::uint64_t correct) noexcept {
  return binomial_at_least(trials, correct, kChance);
}

double equivalence_p(std::uint64_t trials, std::uint64_t correct, double bound) noexcept {
  return binomial_at_most(trials, correct, bound);
}

double difference_power(std::uint64_t trials, double p, double alpha) noexcept {
  return binomial_at_least(trials, least_above_chance(trials, alpha), p);
}

double equivalence_power(std::uint64_t trials, double bound, double alpha) noexcept {
  const std::optional<std::uint64_t> most = most_below(trials, bound, alpha);
  return most ? binomial_at_most(trials, *most, kChance) : 0.0;
}

std::optional<Needed> trials_for_difference(double p, double power, double alpha) {
  if (!(p > kChance)) return std::nullopt;
  return needed(power, [&](std::uint64_t n) { return difference_power(n, p, alpha); });
}

std::optional<Needed> trials_for_equivalence(double bound, double power, double alpha) {
  if (!(bound > kChance)) return std::nullopt;
  return needed(power, [&](std::uint64_t n) { return equivalence_power(n, bound, alpha); });
}

std::optional<double> shown_bound(std::uint64_t trials, double power, double alpha) {
  for (int i = 1; i <= kThousandths; ++i) {
    const double bound = kChance + kThousandth * i;
    if (equivalence_power(trials, bound, alpha) >= power) return bound;
  }
  return std::nullopt;
}

}  // namespace palpate::experiments::psychophysics
