// Detection theory: the sensitivity d' from each task's answers.
//
// d' is the distance between the means of two unit normal sensations. Sources: Macmillan and Creelman,
// Detection Theory: A User's Guide (2nd edition 2005), chapters 1, 7 and 9; Hautus and Meng, Decision
// strategies in the ABX (matching-to-sample) psychophysical task, Perception & Psychophysics 64 (2002);
// Hautus, Corrections for extreme proportions, Behavior Research Methods 27 (1995). Pure functions,
// thread-safe.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "toolkit/core/statistics.h"

namespace palpate::experiments::psychophysics {

enum class Task : std::uint8_t {
  kAbx,            ///< A, B, then X: is X the first or the second?
  kSameDifferent,  ///< two intervals: the same or different?
  kTwoInterval,    ///< two intervals: which has more? (2IFC, 2AFC)
  kYesNo           ///< one interval: the standard or the other?
};
inline constexpr std::array kTasks = {Task::kAbx, Task::kSameDifferent, Task::kTwoInterval, Task::kYesNo};
/// "abx", "same-different", "2ifc", "yes-no".
[[nodiscard]] const char* name_of(Task task) noexcept;
/// Felt intervals in a trial: 3, 2, 2, 1.
[[nodiscard]] std::size_t intervals_of(Task task) noexcept;

/// Rule by which an observer compares sensations. Two-interval choice and yes-no have only one strategy.
enum class Strategy : std::uint8_t {
  kDifferencing,  ///< compares differences of sensations, as people do where places vary
  kIndependent    ///< judges each sensation by itself: optimal
};

/// Largest distinguishable d': at 6 a two-interval choice fails once in 90,000 trials.
inline constexpr double kLargestDprime = 6.0;

/// Share of right answers of an unbiased observer; d' >= 0. ABX: Hautus and Meng's equations (Macmillan and
/// Creelman 9.11 and 9.12); same-different: 9.4 with the best criterion of 9.7; the others: Phi(d'/sqrt 2)
/// and Phi(d'/2).
[[nodiscard]] double proportion_correct(Task task, Strategy strategy, double dprime) noexcept;
/// The d' in [0, kLargestDprime] with this share; 0 at and below chance.
[[nodiscard]] double dprime_of_proportion(Task task, Strategy strategy, double proportion) noexcept;

/// Answers by stimulus. `signals`: trials of the second kind ("different", "the comparison first", "the
/// other"), of which `hits` were answered so; `noises`: the others, of which `false_alarms` were answered so.
struct Answers {
  std::uint64_t hits = 0, signals = 0, false_alarms = 0, noises = 0;
  [[nodiscard]] std::uint64_t trials() const noexcept { return signals + noises; }
  [[nodiscard]] std::uint64_t correct() const noexcept { return hits + (noises - false_alarms); }
};

/// A number with its 95 % interval.
struct Estimate {
  double value = 0.0;
  Interval interval{};
};

/// Sensitivity d' with the criterion of biased answers, from both kinds of trials; empty if one kind is
/// missing. The value has Hautus's correction (half an answer added to each cell); the interval is the
/// profile likelihood's. Two-interval choice and yes-no take the wider of that and the mapped exact interval
/// of the share of right answers, since a profile alone covers too rarely with few wrong answers. ABX, whose
/// kinds are alike, maps the exact interval of the share of right answers: it covers in at least 95 of 100
/// experiments, and a bias lowers d'. Same-different under independent observations gives a value only,
/// mapped from the unbiased share (Macmillan and Creelman 9.6). `criterion` is in sensation deviations from
/// the unbiased place; for same-different it is the difference called one.
struct Sensitivity {
  Estimate dprime;
  bool has_interval = true;
  std::optional<double> criterion;
};
[[nodiscard]] std::optional<Sensitivity> sensitivity(Task task, Strategy strategy, const Answers& answers);

}  // namespace palpate::experiments::psychophysics
