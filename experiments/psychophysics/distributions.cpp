#include "experiments/psychophysics/distributions.h"

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

}  // namespace

double normal_cdf(double z) noexcept {
  return 0.5 * std::erfc(-z / std::numbers::sqrt2);
}

double normal_quantile(double p) noexcept {
  return -std::numbers::sqrt2 * math::erfc_inv(2.0 * p, Quiet());
}

double beta_cdf(double x, double a, double b) noexcept {
  return math::ibeta(a, b, x, Quiet());
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

Interval clopper_pearson(std::uint64_t n, std::uint64_t k, double alpha) noexcept {
  const auto hits = static_cast<double>(k), misses = static_cast<double>(n - k);
  Interval interval{0.0, 1.0};
  if (k > 0) interval.low = math::ibeta_inv(hits, misses + 1.0, 0.5 * alpha, Quiet());
  if (k < n) interval.high = math::ibeta_inv(hits + 1.0, misses, 1.0 - 0.5 * alpha, Quiet());
  return interval;
}

}  // namespace palpate::experiments::psychophysics
