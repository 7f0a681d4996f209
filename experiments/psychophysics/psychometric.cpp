#include "experiments/psychophysics/psychometric.h"

#include <algorithm>
#include <array>
#include <boost/math/special_functions/beta.hpp>
#include <boost/math/special_functions/erf.hpp>
#include <cmath>
#include <limits>
#include <numbers>

#include "toolkit/core/statistics.h"

namespace palpate::experiments::psychophysics {
namespace {

// Farthest JND beyond the levels that they can support.
const double kBeyondLevels = std::log(10.0);
// From a nearly flat line to a step over the whole range.
const double kLeastLogSlope = std::log(0.25), kMostLogSlope = std::log(8.0);
constexpr int kGridJnd = 24, kGridSlope = 7;           // starting grid: no likelihood peak is narrower than
                                                       // 1/24 of the range
constexpr double kFirstStep = 0.25, kLastStep = 1e-4;  // in logarithms: to 0.01 %
// Probability that replaces a fitted share of 0 or 1.
constexpr double kLeastShare = 1e-12;

struct Place {
  double log_jnd = 0.0, log_slope = 0.0;
};

double log_likelihood_at(std::span<const LevelAnswers> levels, Psychometric function, const Place& place) {
  function.jnd = std::exp(place.log_jnd);
  function.slope = std::exp(place.log_slope);
  double sum = 0.0;
  for (const LevelAnswers& one : levels) {
    const double p = std::clamp(function.proportion(one.level), kLeastShare, 1.0 - kLeastShare);
    sum += static_cast<double>(one.correct) * std::log(p) +
           static_cast<double>(one.trials - one.correct) * std::log1p(-p);
  }
  return sum;
}

struct Search {
  double low = 0.0, high = 0.0;  ///< bounds of log_jnd
  bool slope_is_free = false;
  [[nodiscard]] bool holds(const Place& p) const {
    return p.log_jnd >= low && p.log_jnd <= high &&
           (!slope_is_free || (p.log_slope >= kLeastLogSlope && p.log_slope <= kMostLogSlope));
  }
};

/// Hill climbing from `at` in shrinking steps: along the axes and, if both are free, the diagonals.
Place climbed(std::span<const LevelAnswers> levels, const Psychometric& like, const Search& search,
              Place at) {
  constexpr std::array<std::array<double, 2>, 8> kWays = {
      {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, -1}, {1, -1}, {-1, 1}}};
  const std::size_t ways = search.slope_is_free ? kWays.size() : 2;
  double best = log_likelihood_at(levels, like, at);
  for (double step = kFirstStep; step > kLastStep;) {
    bool moved = false;
    for (std::size_t i = 0; i < ways; ++i) {
      const Place to{at.log_jnd + step * kWays[i][0], at.log_slope + step * kWays[i][1]};
      if (!search.holds(to)) continue;
      const double value = log_likelihood_at(levels, like, to);
      if (value <= best) continue;
      best = value, at = to, moved = true;
    }
    if (!moved) step *= 0.5;
  }
  return at;
}

Search search_over(std::span<const LevelAnswers> levels, bool slope_is_free) {
  double least = std::numeric_limits<double>::infinity(), most = 0.0;
  for (const LevelAnswers& one : levels) {
    if (one.trials == 0 || !(one.level > 0.0)) continue;
    least = std::min(least, one.level);
    most = std::max(most, one.level);
  }
  return {std::log(least) - kBeyondLevels, std::log(most) + kBeyondLevels, slope_is_free};
}

Place best_of_grid(std::span<const LevelAnswers> levels, const Psychometric& like, const Search& search,
                   double log_slope) {
  Place best;
  double highest = -std::numeric_limits<double>::infinity();
  const int slopes = search.slope_is_free ? kGridSlope : 1;
  for (int i = 0; i < kGridJnd; ++i)
    for (int j = 0; j < slopes; ++j) {
      const Place at{search.low + (search.high - search.low) * (i + 0.5) / kGridJnd,
                     search.slope_is_free
                         ? kLeastLogSlope + (kMostLogSlope - kLeastLogSlope) * (j + 0.5) / kGridSlope
                         : log_slope};
      const double value = log_likelihood_at(levels, like, at);
      if (value > highest) highest = value, best = at;
    }
  return best;
}

double deviance_of(std::span<const LevelAnswers> levels, double log_likelihood) {
  double saturated = 0.0;
  for (const LevelAnswers& one : levels) {
    const auto k = static_cast<double>(one.correct), n = static_cast<double>(one.trials);
    if (one.correct > 0) saturated += k * std::log(k / n);
    if (one.correct < one.trials) saturated += (n - k) * std::log((n - k) / n);
  }
  return std::max(0.0, 2.0 * (saturated - log_likelihood));
}

}  // namespace

const char* name_of(Shape shape) noexcept {
  return shape == Shape::kDprime ? "dprime" : "weibull";
}

double dprime_at_jnd(Task task) noexcept {
  constexpr double kThreeOfFour = 0.75;
  static const double kOfAbx = dprime_of_proportion(Task::kAbx, Strategy::kDifferencing, kThreeOfFour);
  static const double kOfTwo =
      dprime_of_proportion(Task::kTwoInterval, Strategy::kDifferencing, kThreeOfFour);
  return task == Task::kAbx ? kOfAbx : kOfTwo;
}

double Psychometric::proportion(double x) const noexcept {
  if (!(x > 0.0)) return 0.5;
  const double power = std::pow(x / jnd, slope);
  const double f =
      shape == Shape::kWeibull
          ? 1.0 - std::exp2(-power)
          : 2.0 * proportion_correct(task, Strategy::kDifferencing, dprime_at_jnd(task) * power) - 1.0;
  return 0.5 + (0.5 - lapse) * f;
}

std::optional<PsychometricFit> fit_psychometric(std::span<const LevelAnswers> levels,
                                                const Psychometric& like, std::optional<double> slope) {
  const Search search = search_over(levels, !slope);
  if (!(search.high > search.low) || !std::isfinite(search.low)) return std::nullopt;
  const Place start = best_of_grid(levels, like, search, std::log(slope.value_or(kUsualSlope)));
  const Place at = climbed(levels, like, search, start);
  PsychometricFit fit;
  fit.function = like;
  fit.function.jnd = std::exp(at.log_jnd);
  fit.function.slope = std::exp(at.log_slope);
  fit.log_likelihood = log_likelihood_at(levels, like, at);
  fit.deviance = deviance_of(levels, fit.log_likelihood);
  fit.at_edge = at.log_jnd - search.low < kFirstStep || search.high - at.log_jnd < kFirstStep;
  return fit;
}

Interval percentiles(std::vector<double>& values) {
  constexpr double kWhole = 100.0;
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  return {nearest_rank(values, kIntervalTailPercent), nearest_rank(values, kWhole - kIntervalTailPercent)};
}

Interval bootstrap_jnd(std::span<const LevelAnswers> levels, const PsychometricFit& fit,
                       std::optional<double> slope, std::uint64_t seed, int resamples) {
  Random random(seed);
  std::vector<double> jnds;
  std::vector<LevelAnswers> drawn(levels.begin(), levels.end());
  const Search search = search_over(levels, !slope);
  for (int r = 0; r < resamples; ++r) {
    for (std::size_t i = 0; i < levels.size(); ++i) {
      const double p = fit.function.proportion(levels[i].level);
      drawn[i].correct = 0;
      for (std::uint64_t k = 0; k < levels[i].trials; ++k) drawn[i].correct += random.uniform() < p ? 1u : 0u;
    }
    const Place start{std::clamp(std::log(fit.function.jnd), search.low, search.high),
                      std::log(fit.function.slope)};
    jnds.push_back(std::exp(climbed(drawn, fit.function, search, start).log_jnd));
  }
  return percentiles(jnds);
}

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
