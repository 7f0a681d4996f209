// Percentiles by nearest rank, medians, and the percentile bootstrap.
#pragma once

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include <palpate/clock.h>
#include "toolkit/core/random.h"

namespace palpate {

/// Index of the p-th percentile by nearest rank among n sorted samples: rank ceil(p / 100 * n) from 1; p = 0
/// is the smallest. No interpolation. n > 0, 0 <= percent <= 100.
[[nodiscard]] inline std::size_t nearest_rank_index(std::size_t n, double percent) noexcept {
  // Relative error of percent * n / 100: a product, a quotient and the percentage, each half an epsilon;
  // doubled. Without it the rank of 99.9 % of 1000, slightly over 999 in floating point, would be one too
  // high.
  constexpr double kRankSlack = 4.0 * std::numeric_limits<double>::epsilon();
  assert(n > 0);
  const double count = static_cast<double>(n);
  const double exact = percent * count / 100.0;
  const double rank = std::ceil(exact - exact * kRankSlack);
  return static_cast<std::size_t>(std::clamp(rank, 1.0, count)) - 1;
}

/// The sample there. `sorted` must not be empty.
template <class T>
[[nodiscard]] T nearest_rank(const std::vector<T>& sorted, double percent) noexcept {
  return sorted[nearest_rank_index(sorted.size(), percent)];
}

/// The median and the 99th percentile of values in any order; unchanged where there are none. O(n log n).
inline void median_and_tail(std::vector<double> values, std::optional<double>& p50,
                            std::optional<double>& p99) {
  constexpr double kMedian = 50.0, kTail = 99.0;
  if (values.empty()) return;
  std::sort(values.begin(), values.end());
  p50 = nearest_rank(values, kMedian);
  p99 = nearest_rank(values, kTail);
}

/// The median, the upper one for an even count; not empty. O(n).
template <class T>
[[nodiscard]] T upper_median(std::vector<T> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The percentile bootstrap over clusters (Efron and Tibshirani 1993, chapter 13): the uncertainty of a number
// if other clusters of the same kind were met. Frames of a contact episode are dependent; episodes are nearly
// independent.

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
