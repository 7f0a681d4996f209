// The percentile bootstrap over clusters (Efron and Tibshirani 1993, chapter 13): the uncertainty of a number
// if other clusters of the same kind were met. Frames of a contact episode are dependent; episodes are nearly
// independent.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <palpate/interval.h>
#include "toolkit/core/percentiles.h"
#include "toolkit/core/random.h"

namespace palpate {

/// 25 resamples lie beyond either end, so the ends depend little on the seed.
inline constexpr int kResamples = 1000;
inline constexpr double kIntervalTailPercent = 2.5;
inline constexpr std::uint64_t kBootstrapSeed = 20061122;

/// `statistic(counts, random)` is the number with cluster i drawn counts[i] times, or nothing; `random` is
/// for resampling beside the clusters. Empty without clusters or numbers. Deterministic per seed.
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
