// How far a number would move if the experiment met other clusters of the same kind: the percentile
// bootstrap (Efron and Tibshirani 1993, chapter 13) over whole clusters. Frames of one contact episode follow
// each other and are no independent samples; episodes are as good as that.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "toolkit/core/nearest_rank.h"
#include "toolkit/core/random.h"

namespace palpate {

/// 95 % of the resampled numbers lie in it.
struct Interval {
  double low = 0.0, high = 0.0;
};

/// 25 resamples lie beyond either end: enough that another seed moves an end by little.
inline constexpr int kResamples = 1000;
inline constexpr double kIntervalTailPercent = 2.5;
inline constexpr std::uint64_t kBootstrapSeed = 20061122;

/// `statistic(counts, random)` is the number where cluster i is drawn counts[i] times, or nothing where that
/// draw has none; `random` is for what it resamples beside the clusters. Nothing without clusters, or where
/// no draw has a number. The same seed, the same interval.
template <class Statistic>
[[nodiscard]] std::optional<Interval> bootstrap(std::size_t clusters, Statistic&& statistic,
                                                int resamples = kResamples) {
  if (clusters == 0) return std::nullopt;
  Random random(kBootstrapSeed);
  std::vector<std::uint32_t> counts(clusters);
  std::vector<double> numbers;
  numbers.reserve(static_cast<std::size_t>(resamples));
  for (int r = 0; r < resamples; ++r) {
    std::fill(counts.begin(), counts.end(), 0u);
    for (std::size_t i = 0; i < clusters; ++i) ++counts[random.below(clusters)];
    if (const std::optional<double> number = statistic(std::span<const std::uint32_t>(counts), random))
      numbers.push_back(*number);
  }
  if (numbers.empty()) return std::nullopt;
  std::sort(numbers.begin(), numbers.end());
  constexpr double kWhole = 100.0;
  return Interval{nearest_rank(numbers, kIntervalTailPercent),
                  nearest_rank(numbers, kWhole - kIntervalTailPercent)};
}

}  // namespace palpate
