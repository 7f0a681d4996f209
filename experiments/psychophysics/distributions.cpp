#include "experiments/psychophysics/distributions.h"

#include <cmath>
#include <limits>
#include <numbers>

namespace palpate::experiments::psychophysics {
namespace {

// Below this the tail's approximation of the quantile is used (Acklam).
constexpr double kTail = 0.02425;
// Of the continued fraction: it converges in O(sqrt(max(a, b))) steps, so this serves a million trials.
constexpr int kMostTerms = 5000;
constexpr double kTiny = 1e-300;  // in the place of a zero that would be divided by
// Halvings of [0, 1] until its ends are neighbours: a double has 53 bits.
constexpr int kHalvings = 60;

double tail_quantile(double q) noexcept {
  return (((((-7.784894002430293e-03 * q - 3.223964580411365e-01) * q - 2.400758277161838) * q -
            2.549732539343734) *
               q +
           4.374664141464968) *
              q +
          2.938163982698783) /
         ((((7.784695709041462e-03 * q + 3.224671290700398e-01) * q + 2.445134137142996) * q +
           3.754408661907416) *
              q +
          1.0);
}

double middle_quantile(double q) noexcept {
  const double r = q * q;
  return (((((-3.969683028665376e+01 * r + 2.209460984245205e+02) * r - 2.759285104469687e+02) * r +
            1.383577518672690e+02) *
               r -
           3.066479806614716e+01) *
              r +
          2.506628277459239) *
         q /
         (((((-5.447609879822406e+01 * r + 1.615858368580409e+02) * r - 1.556989798598866e+02) * r +
            6.680131188771972e+01) *
               r -
           1.328068155288572e+01) *
              r +
          1.0);
}

double not_zero(double value) noexcept {
  return std::abs(value) < kTiny ? kTiny : value;
}

/// The fraction itself, for x on the side where it converges fast.
double beta_fraction(double x, double a, double b) noexcept {
  double c = 1.0, d = 1.0 / not_zero(1.0 - (a + b) * x / (a + 1.0)), h = d;
  for (int m = 1; m <= kMostTerms; ++m) {
    const double even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
    d = 1.0 / not_zero(1.0 + even * d);
    c = not_zero(1.0 + even / c);
    h *= d * c;
    const double odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
    d = 1.0 / not_zero(1.0 + odd * d);
    c = not_zero(1.0 + odd / c);
    h *= d * c;
    if (std::abs(d * c - 1.0) < std::numeric_limits<double>::epsilon()) break;
  }
  return h;
}

/// The x in [0, 1] where I_x(a, b) is p.
double beta_quantile(double p, double a, double b) noexcept {
  double low = 0.0, high = 1.0;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (beta_cdf(middle, a, b) < p ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace

double normal_cdf(double z) noexcept {
  return 0.5 * std::erfc(-z / std::numbers::sqrt2);
}

double normal_density(double z) noexcept {
  return std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
}

double normal_quantile(double p) noexcept {
  double z = p < kTail         ? tail_quantile(std::sqrt(-2.0 * std::log(p)))
             : p > 1.0 - kTail ? -tail_quantile(std::sqrt(-2.0 * std::log1p(-p)))
                               : middle_quantile(p - 0.5);
  const double density = normal_density(z);
  if (!(density > 0.0)) return z;
  const double u = (normal_cdf(z) - p) / density;
  return z - u / (1.0 + 0.5 * z * u);
}

double beta_cdf(double x, double a, double b) noexcept {
  if (!(x > 0.0)) return 0.0;
  if (!(x < 1.0)) return 1.0;
  const double front =
      std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x));
  if (x < (a + 1.0) / (a + b + 2.0)) return front * beta_fraction(x, a, b) / a;
  return 1.0 - front * beta_fraction(1.0 - x, b, a) / b;
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
  if (k > 0) interval.low = beta_quantile(0.5 * alpha, hits, misses + 1.0);
  if (k < n) interval.high = beta_quantile(1.0 - 0.5 * alpha, hits + 1.0, misses);
  return interval;
}

}  // namespace palpate::experiments::psychophysics
