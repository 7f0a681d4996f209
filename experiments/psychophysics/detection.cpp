#include "experiments/psychophysics/detection.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "experiments/psychophysics/psychometric.h"

namespace palpate::experiments::psychophysics {
namespace {

constexpr double kRoot2 = std::numbers::sqrt2;
const double kRoot6 = std::sqrt(6.0);
constexpr double kMostCriterion = 8.0;  // beyond it every answer is the same
constexpr int kGoldenSteps = 32;        // 0.618^32 is 2e-7, finer than a likelihood can resolve
constexpr int kBisections = 44;
constexpr double kChanceShare = 0.5;
// Half of chi-square's 95th percentile at one degree of freedom (Wilks 1938).
constexpr double kProfileDrop = 1.920729410347062;
// Hautus 1995: adds half an answer to each cell.
constexpr double kHalfAnswer = 0.5;

/// Share of "different" answers with means d' apart and criterion k.
double called_different(double dprime, double k) {
  return normal_cdf((dprime - k) / kRoot2) + normal_cdf((-dprime - k) / kRoot2);
}

struct Rates {
  double hit = 0.0, false_alarm = 0.0;
};
Rates rates_of(Task task, double dprime, double k) {
  switch (task) {
    case Task::kSameDifferent:
      return {called_different(dprime, k), called_different(0.0, k)};
    case Task::kTwoInterval:
      return {normal_cdf(dprime / kRoot2 - k), normal_cdf(-dprime / kRoot2 - k)};
    case Task::kYesNo:
    case Task::kAbx:
      break;
  }
  return {normal_cdf(0.5 * dprime - k), normal_cdf(-0.5 * dprime - k)};
}

double log_of(std::uint64_t count, double probability) {
  constexpr double kLeast = 1e-300;
  return count == 0 ? 0.0 : static_cast<double>(count) * std::log(std::max(probability, kLeast));
}

double log_likelihood(const Rates& r, const Answers& a) {
  return log_of(a.hits, r.hit) + log_of(a.signals - a.hits, 1.0 - r.hit) +
         log_of(a.false_alarms, r.false_alarm) + log_of(a.noises - a.false_alarms, 1.0 - r.false_alarm);
}

/// Position of the maximum of a unimodal `f` on [low, high].
template <class Function>
double highest(double low, double high, Function&& f) {
  const double share = std::numbers::phi - 1.0;
  double left = high - share * (high - low), right = low + share * (high - low);
  double at_left = f(left), at_right = f(right);
  for (int i = 0; i < kGoldenSteps; ++i) {
    if (at_left > at_right) {
      high = right;
      right = left, at_right = at_left;
      left = high - share * (high - low);
      at_left = f(left);
    } else {
      low = left;
      left = right, at_left = at_right;
      right = low + share * (high - low);
      at_right = f(right);
    }
  }
  return 0.5 * (low + high);
}

double profile(Task task, const Answers& answers, double dprime) {
  const double least = task == Task::kSameDifferent ? 0.0 : -kMostCriterion;
  const auto at = [&](double k) { return log_likelihood(rates_of(task, dprime, k), answers); };
  return at(highest(least, kMostCriterion, at));
}

/// All d' whose likelihood is within the drop from the maximum.
Interval profile_interval(Task task, const Answers& answers) {
  const double least = task == Task::kSameDifferent ? 0.0 : -kLargestDprime;
  const auto at = [&](double d) { return profile(task, answers, d); };
  const double best = highest(least, kLargestDprime, at), floor = at(best) - kProfileDrop;
  const auto end_towards = [&](double out) {
    if (at(out) >= floor) return out;
    double in = best;
    for (int i = 0; i < kBisections; ++i) {
      const double middle = 0.5 * (in + out);
      (at(middle) >= floor ? in : out) = middle;
    }
    return in;
  };
  return {end_towards(least), end_towards(kLargestDprime)};
}

struct CorrectedRates {
  double hit, false_alarm;
};
CorrectedRates corrected(const Answers& a) {
  return {(static_cast<double>(a.hits) + kHalfAnswer) / (static_cast<double>(a.signals) + 1.0),
          (static_cast<double>(a.false_alarms) + kHalfAnswer) / (static_cast<double>(a.noises) + 1.0)};
}

Estimate widened(double value, Interval interval) {
  return {value, {std::min(interval.low, value), std::max(interval.high, value)}};
}

Sensitivity same_different(const Answers& answers) {
  const CorrectedRates r = corrected(answers);
  const double k = -kRoot2 * normal_quantile(0.5 * r.false_alarm);
  double low = 0.0, high = kLargestDprime;
  for (int i = 0; i < kBisections; ++i) {
    const double middle = 0.5 * (low + high);
    (called_different(middle, k) < r.hit ? low : high) = middle;
  }
  const double value = r.hit > r.false_alarm ? 0.5 * (low + high) : 0.0;
  return {widened(value, profile_interval(Task::kSameDifferent, answers)), true, k};
}

}  // namespace

const char* name_of(Task task) noexcept {
  switch (task) {
    case Task::kAbx:
      return "abx";
    case Task::kSameDifferent:
      return "same-different";
    case Task::kTwoInterval:
      return "2ifc";
    case Task::kYesNo:
      return "yes-no";
  }
  return "";
}

std::size_t intervals_of(Task task) noexcept {
  constexpr std::size_t kOfAbx = 3;
  return task == Task::kAbx ? kOfAbx : task == Task::kYesNo ? 1 : 2;
}

double proportion_correct(Task task, Strategy strategy, double dprime) noexcept {
  const bool differencing = strategy == Strategy::kDifferencing;
  switch (task) {
    case Task::kAbx: {
      const double apart = dprime / kRoot2, near = differencing ? dprime / kRoot6 : 0.5 * dprime;
      return normal_cdf(apart) * normal_cdf(near) + normal_cdf(-apart) * normal_cdf(-near);
    }
    case Task::kSameDifferent: {
      if (!differencing) {
        const double one = normal_cdf(0.5 * dprime);
        return one * one + (1.0 - one) * (1.0 - one);
      }
      const auto share = [&](double k) {
        return 0.5 * (called_different(dprime, k) + 1.0 - called_different(0.0, k));
      };
      return std::max(0.5, share(highest(0.0, kMostCriterion, share)));
    }
    case Task::kTwoInterval:
      return normal_cdf(dprime / kRoot2);
    case Task::kYesNo:
      break;
  }
  return normal_cdf(0.5 * dprime);
}

double dprime_of_proportion(Task task, Strategy strategy, double proportion) noexcept {
  if (!(proportion > 0.5)) return 0.0;
  double low = 0.0, high = kLargestDprime;
  for (int i = 0; i < kBisections; ++i) {
    const double middle = 0.5 * (low + high);
    (proportion_correct(task, strategy, middle) < proportion ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

std::optional<Sensitivity> sensitivity(Task task, Strategy strategy, const Answers& answers) {
  if (answers.trials() == 0) return std::nullopt;
  if (task == Task::kAbx) {
    const Interval share = clopper_pearson(answers.trials(), answers.correct());
    const auto mapped = [&](double p) { return dprime_of_proportion(task, strategy, p); };
    const double value =
        mapped(static_cast<double>(answers.correct()) / static_cast<double>(answers.trials()));
    return Sensitivity{{value, {mapped(share.low), mapped(share.high)}}, true, std::nullopt};
  }
  if (answers.signals == 0 || answers.noises == 0) return std::nullopt;
  const CorrectedRates r = corrected(answers);
  const double hit = normal_quantile(r.hit), false_alarm = normal_quantile(r.false_alarm);
  if (task == Task::kSameDifferent) {
    if (strategy == Strategy::kDifferencing) return same_different(answers);
    const double unbiased = normal_cdf(0.5 * (hit - false_alarm));
    const double value = dprime_of_proportion(task, strategy, unbiased);
    return Sensitivity{{value, {value, value}}, false, std::nullopt};
  }
  const double scale = task == Task::kTwoInterval ? 1.0 / kRoot2 : 1.0;
  const Interval fitted = profile_interval(task, answers);
  const Interval share = clopper_pearson(answers.trials(), answers.correct());
  const Interval mapped{
      share.low > kChanceShare ? dprime_of_proportion(task, strategy, share.low) : fitted.low,
      dprime_of_proportion(task, strategy, share.high)};
  return Sensitivity{widened(scale * (hit - false_alarm),
                             {std::min(fitted.low, mapped.low), std::max(fitted.high, mapped.high)}),
                     true, -0.5 * (hit + false_alarm)};
}

}  // namespace palpate::experiments::psychophysics
