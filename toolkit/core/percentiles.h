// Percentiles by nearest rank and medians.
#pragma once

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

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

/// The median, the upper one for an even count; not empty. O(n).
template <class T>
[[nodiscard]] T upper_median(std::vector<T> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace palpate
