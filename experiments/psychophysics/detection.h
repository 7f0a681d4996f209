// Detection theory: how far apart two things are felt, d', from the answers of each task.
//
// d' is the distance of the means of two unit normal sensations. Sources: Macmillan and Creelman, Detection
// Theory: A User's Guide (2nd edition 2005), chapters 1, 7 and 9; Hautus and Meng, Decision strategies in the
// ABX (matching-to-sample) psychophysical task, Perception & Psychophysics 64 (2002); Hautus, Corrections for
// extreme proportions, Behavior Research Methods 27 (1995). Pure functions, thread-safe.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "toolkit/core/bootstrap.h"

namespace palpate::experiments::psychophysics {

enum class Task : std::uint8_t {
  kAbx,            ///< A, B, then X: is X the first or the second?
  kSameDifferent,  ///< two intervals: the same or different?
  kTwoInterval,    ///< two intervals, one with more: the first or the second? (2IFC, 2AFC)
  kYesNo           ///< one interval: the standard or the other?
};
inline constexpr std::array kTasks = {Task::kAbx, Task::kSameDifferent, Task::kTwoInterval, Task::kYesNo};
/// "abx", "same-different", "2ifc", "yes-no".
[[nodiscard]] const char* name_of(Task task) noexcept;
/// Intervals that are felt in a trial: 3, 2, 2, 1.
[[nodiscard]] std::size_t intervals_of(Task task) noexcept;

/// How an observer compares what was felt. Two-interval choice and yes-no know one way only.
enum class Strategy : std::uint8_t {
  kDifferencing,  ///< differences of sensations are compared: what people do where places vary
  kIndependent    ///< each sensation is judged by itself: the best that can be done
};
[[nodiscard]] const char* name_of(Strategy strategy) noexcept;

/// No d' beyond this is told from another: at 6 a two-interval choice fails once in 90,000 trials.
inline constexpr double kLargestDprime = 6.0;

/// Share of right answers of an observer without bias; d' >= 0. ABX: Hautus and Meng's equations (Macmillan
/// and Creelman 9.11 and 9.12); same-different: 9.4 and the best criterion of 9.7; the others Phi(d'/sqrt 2)
/// and Phi(d'/2).
[[nodiscard]] double proportion_correct(Task task, Strategy strategy, double dprime) noexcept;
/// The d' in [0, kLargestDprime] that gives this share; 0 at and below chance.
[[nodiscard]] double dprime_of_proportion(Task task, Strategy strategy, double proportion) noexcept;

/// Answers by what was shown. `signals`: trials that hold the second kind ("different", "the comparison
/// first", "the other"); `hits` those answered so; `noises` all others, `false_alarms` those answered so.
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

/// d' of answers that have a bias: criterion and d' together, the value with Hautus's correction (half an
/// answer added to each cell), the interval by the profile of the likelihood; of a two-interval choice and
/// yes-no the wider of that and of the exact interval of the share of right answers, mapped: with few wrong
/// answers a profile alone covers too rarely. Nothing without both kinds of trials. Of ABX, where the two
/// kinds are alike, the exact interval of the share of right answers is mapped, so the interval covers in at
/// least 95 of 100 experiments; a bias makes d' seem smaller there. Of same-different under independent
/// observations: value alone, mapped from the unbiased share (Macmillan and Creelman 9.6). `criterion` is in
/// units of the sensation's deviation, from the unbiased place; of same-different, the difference that is
/// called one.
struct Sensitivity {
  Estimate dprime;
  bool has_interval = true;
  std::optional<double> criterion;
};
[[nodiscard]] std::optional<Sensitivity> sensitivity(Task task, Strategy strategy, const Answers& answers);

}  // namespace palpate::experiments::psychophysics
