// How many trials a study needs, before anybody is asked: of an exact one-sided binomial test against chance,
// and of an equivalence test, since a difference that was missed proves nothing.
//
// The power of an exact test is a saw tooth of the number of trials. So two numbers are given: the first that
// reaches the power, and the one from which on every larger number does. Pure functions, thread-safe.
#pragma once

#include <cstdint>
#include <optional>

namespace palpate::experiments::psychophysics {

inline constexpr double kUsualPower = 0.8;
/// Of a guess between two answers.
inline constexpr double kChance = 0.5;
/// Nobody sits through more; also bounds the search.
inline constexpr std::uint64_t kMostTrials = 20'000;

struct Needed {
  std::uint64_t first = 0;  ///< the smallest number that reaches the power
  std::uint64_t safe = 0;   ///< it and every larger number reach it
};

/// P-values: of hits or more by chance alone; of hits or fewer where the share of right answers is `bound`.
[[nodiscard]] double difference_p(std::uint64_t trials, std::uint64_t correct) noexcept;
[[nodiscard]] double equivalence_p(std::uint64_t trials, std::uint64_t correct, double bound) noexcept;

/// Fewest right answers that are above chance at `alpha`; trials + 1 where none are.
[[nodiscard]] std::uint64_t least_above_chance(std::uint64_t trials, double alpha) noexcept;
/// Chance that a share `p` of right answers is found to be above chance.
[[nodiscard]] double difference_power(std::uint64_t trials, double p, double alpha) noexcept;
/// Chance that pure guessing is found to be below `bound`.
[[nodiscard]] double equivalence_power(std::uint64_t trials, double bound, double alpha) noexcept;

/// Nothing where kMostTrials are not enough, or the share is not above chance.
[[nodiscard]] std::optional<Needed> trials_for_difference(double p, double power, double alpha);
[[nodiscard]] std::optional<Needed> trials_for_equivalence(double bound, double power, double alpha);

/// The smallest share, to 0.001, that so many trials of guessing show not to be reached, at this power.
/// Nothing where even 0.999 is not shown.
[[nodiscard]] std::optional<double> shown_bound(std::uint64_t trials, double power, double alpha);

}  // namespace palpate::experiments::psychophysics
