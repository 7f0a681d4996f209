#include "toolkit/local_delaunay/spatial_sort.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "toolkit/local_delaunay/local_delaunay_mesh.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace palpate::local_delaunay {
namespace {

/// Floats as integers in the same order, with equal zeros; vector code compares and counts them on every
/// processor.
using Keys = std::array<std::int32_t, SplitGroup::kRoom>;
constexpr std::int32_t kNotSign = 0x7FFFFFFF;
constexpr std::int32_t kLeast = std::numeric_limits<std::int32_t>::min(),
                       kMost = std::numeric_limits<std::int32_t>::max();

// Inlined into both forms, to be compiled for each.
#define PALPATE_BOTH [[gnu::always_inline]] inline

PALPATE_BOTH std::int32_t key_of(float x) noexcept {
  const auto bits = std::bit_cast<std::int32_t>(x + 0.0F);
  return bits ^ (bits >> 31 & kNotSign);
}
PALPATE_BOTH float value_of(std::int32_t key) noexcept {
  return std::bit_cast<float>(key ^ (key >> 31 & kNotSign));
}

/// Selects by a mask of all bits or none; compilers do not vectorise a condition here.
PALPATE_BOTH std::int32_t chosen(std::int32_t mask, std::int32_t one, std::int32_t other) noexcept {
  return (one & mask) | (other & ~mask);
}

/// The division of a range: keys below `bound` go left, and as many equal ones as fit.
struct Divide {
  std::int32_t bound;
  std::size_t equal_left;  ///< number of keys equal to `bound` that go left
  bool splits_equal;       ///< equal keys go to both sides
};

/// The keys below `pivot`: their number, the highest, and the lowest of the others.
struct Below {
  std::size_t count;
  std::int32_t highest, next;
};
PALPATE_BOTH Below below(const std::int32_t* key, std::size_t count, std::int32_t pivot) noexcept {
  std::int32_t fewer = 0;
  std::int32_t highest = kLeast, next = kMost;
  for (std::size_t i = 0; i < count; ++i) {
    const std::int32_t is_below = -static_cast<std::int32_t>(key[i] < pivot);  // all bits or none
    fewer -= is_below;
    highest = std::max(highest, chosen(is_below, key[i], kLeast));
    next = std::min(next, chosen(is_below, kMost, key[i]));
  }
  return {static_cast<std::size_t>(fewer), highest, next};
}

/// Pivots guessed from the expected share of keys before bisecting the value range. Random points need three
/// or four.
constexpr int kGuesses = 6;

/// Finds the end of the lowest `left` keys; `low` and `high` are the extremes.
PALPATE_BOTH Divide divide(const std::int32_t* key, std::size_t count, std::size_t left, std::int32_t low,
                           std::int32_t high) noexcept {
  // At most `left` keys are below `low`, more than `left` are at most `high`.
  std::size_t below_low = 0, up_to_high = count;
  for (int probe = 0; low != high; ++probe) {
    const float from = value_of(low), to = value_of(high);
    const float share =
        probe < kGuesses ? static_cast<float>(left - below_low) / static_cast<float>(up_to_high - below_low)
                         : 0.5F;
    // Bisecting values near zero would take as many steps as floats have exponents.
    const std::int32_t guess = probe < 2 * kGuesses
                                   ? key_of(from + share * (to - from))
                                   : static_cast<std::int32_t>((std::int64_t{low} + high) >> 1);
    const std::int32_t pivot = std::clamp(guess, low + 1, high);
    const Below at = below(key, count, pivot);
    if (at.count == left) return {pivot, 0, false};
    if (at.count < left) {
      low = at.next;
      below_low = at.count;
    } else {
      high = at.highest;
      up_to_high = at.count;
    }
  }
  return {low, left - below_low, true};
}

/// Up to this many keys are compared pairwise: most ranges are small.
constexpr std::size_t kCompared = 32;

/// As divide(). `kRoom` >= `count` is the compared length; content beyond `count` is ignored.
template <std::size_t kRoom>
PALPATE_BOTH Divide divide_few(const std::int32_t* key, std::size_t count, std::size_t left) noexcept {
  std::array<std::int32_t, kRoom> before{};
  for (std::size_t j = 0; j < count; ++j)
    for (std::size_t i = 0; i < kRoom; ++i) before[i] += key[j] < key[i] ? 1 : 0;
  std::int32_t goes_left = 0;
  std::int32_t highest_left = kLeast, lowest_right = kMost, below_highest = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const std::int32_t is_left = -static_cast<std::int32_t>(before[i] < static_cast<std::int32_t>(left));
    goes_left -= is_left;
    highest_left = std::max(highest_left, chosen(is_left, key[i], kLeast));
    lowest_right = std::min(lowest_right, chosen(is_left, kMost, key[i]));
    below_highest = std::max(below_highest, before[i] & is_left);
  }
  if (static_cast<std::size_t>(goes_left) == left) return {lowest_right, 0, false};
  return {highest_left, left - static_cast<std::size_t>(below_highest), true};
}

/// Of the points `first` to `last` with a key equal to the bound, marks those that go left.
void choose_equal(const SplitGroup& group, std::size_t first, std::size_t last, Keys& key,
                  const Divide& by) noexcept {
  std::array<std::uint16_t, kGroupPoints> equal;
  std::size_t count = 0;
  for (std::size_t i = first; i < last; ++i)
    if (key[i] == by.bound) equal[count++] = static_cast<std::uint16_t>(i);
  const auto is_before = [&group](std::uint16_t a, std::uint16_t b) {
    for (const auto& axis : group.at)
      if (axis[a] != axis[b]) return axis[a] < axis[b];
    return group.index[a] < group.index[b];
  };
  const auto middle = equal.begin() + static_cast<std::ptrdiff_t>(by.equal_left);
  const auto end = equal.begin() + static_cast<std::ptrdiff_t>(count);
  if (middle < end) std::nth_element(equal.begin(), middle, end, is_before);
  for (auto at = equal.begin(); at != middle; ++at) key[*at] = by.bound - 1;
}

/// Buffers what went right until it is placed behind the left part.
struct Aside {
  std::array<std::array<float, SplitGroup::kRoom>, 3> at;
  std::array<std::uint32_t, SplitGroup::kRoom> index;
};

struct Narrow {
  static void part(SplitGroup& group, std::size_t first, std::size_t last, const Keys& key,
                   std::int32_t bound, Aside& aside) noexcept {
    std::size_t left = first, right = 0;
    for (std::size_t i = first; i < last; ++i) {
      const std::array<float, 3> at = {group.at[0][i], group.at[1][i], group.at[2][i]};
      const std::uint32_t index = group.index[i];
      for (std::size_t axis = 0; axis < 3; ++axis) group.at[axis][left] = aside.at[axis][right] = at[axis];
      group.index[left] = aside.index[right] = index;
      const std::size_t goes_left = key[i] < bound ? 1 : 0;
      left += goes_left;
      right += 1 - goes_left;
    }
    for (std::size_t axis = 0; axis < 3; ++axis)
      std::copy_n(aside.at[axis].begin(), right, group.at[axis].begin() + static_cast<std::ptrdiff_t>(left));
    std::copy_n(aside.index.begin(), right, group.index.begin() + static_cast<std::ptrdiff_t>(left));
  }
};

/// Halves a range down to blocks; `part` moves keys below a bound to the front, in order.
template <class Part>
PALPATE_BOTH void split_range_at_median(SplitGroup& group, std::size_t first, std::size_t last, Keys& key,
                                        Aside& aside, Part&& part) noexcept {
  const std::size_t count = last - first;
  std::size_t longest = 0;
  std::int32_t low = 0, high = 0;
  float extent = -1.0F;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    std::int32_t least = kMost, most = kLeast;
    for (std::size_t i = first; i < last; ++i) {
      const std::int32_t k = key_of(group.at[axis][i]);
      least = std::min(least, k);
      most = std::max(most, k);
    }
    const float along = value_of(most) - value_of(least);
    if (!(along > extent)) continue;
    extent = along;
    longest = axis;
    low = least;
    high = most;
  }
  for (std::size_t i = first; i < last; ++i) key[i] = key_of(group.at[longest][i]);
  const std::size_t blocks = (count + kBlockPlaces - 1) / kBlockPlaces;
  const std::size_t left = (blocks + 1) / 2 * kBlockPlaces;
  const Divide by = count <= kCompared / 2 ? divide_few<kCompared / 2>(&key[first], count, left)
                    : count <= kCompared   ? divide_few<kCompared>(&key[first], count, left)
                                           : divide(&key[first], count, left, low, high);
  if (by.splits_equal) choose_equal(group, first, last, key, by);
  part(group, first, last, key, by.bound, aside);
}

/// Most waiting ranges, one per level.
constexpr std::size_t kWaiting = 8;
static_assert(kGroupPoints <= kBlockPlaces << kWaiting);

template <class Part>
PALPATE_BOTH void split_all_at_medians(SplitGroup& group, Part&& part) noexcept {
  Keys key;
  Aside aside;
  struct Range {
    std::size_t first, last;
  };
  std::array<Range, kWaiting + 1> waiting;
  std::size_t count = 0;
  waiting[count++] = {0, group.size};
  while (count > 0) {
    const Range range = waiting[--count];
    const std::size_t blocks = (range.last - range.first + kBlockPlaces - 1) / kBlockPlaces;
    if (blocks < 2) continue;
    split_range_at_median(group, range.first, range.last, key, aside, part);
    const std::size_t middle = range.first + (blocks + 1) / 2 * kBlockPlaces;
    waiting[count++] = {middle, range.last};
    waiting[count++] = {range.first, middle};
  }
}

#if defined(__x86_64__)
struct Wide {
  PALPATE_AVX2 static void part(SplitGroup& group, std::size_t first, std::size_t last, const Keys& key,
                                std::int32_t bound, Aside& aside) noexcept {
    const __m256i limit = _mm256_set1_epi32(bound);
    const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    std::size_t left = first, right = 0;
    for (std::size_t i = first; i < last; i += kLanes) {
      const __m256i keys = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(&key[i]));
      const __m256i there = _mm256_cmpgt_epi32(_mm256_set1_epi32(static_cast<int>(last - i)), lane);
      const auto lanes = static_cast<unsigned>(_mm256_movemask_ps(_mm256_castsi256_ps(there)));
      const auto is_below =
          static_cast<unsigned>(_mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpgt_epi32(limit, keys)))) &
          lanes;
      const __m256i lefts = positions(is_below), rights = positions(lanes & ~is_below);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const __m256 these = _mm256_loadu_ps(&group.at[axis][i]);
        _mm256_storeu_ps(&group.at[axis][left], _mm256_permutevar8x32_ps(these, lefts));
        _mm256_storeu_ps(&aside.at[axis][right], _mm256_permutevar8x32_ps(these, rights));
      }
      const __m256i these = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(&group.index[i]));
      put(&group.index[left], _mm256_permutevar8x32_epi32(these, lefts));
      put(&aside.index[right], _mm256_permutevar8x32_epi32(these, rights));
      const auto goes_left = static_cast<std::size_t>(__builtin_popcount(is_below));
      left += goes_left;
      right += static_cast<std::size_t>(__builtin_popcount(lanes)) - goes_left;
    }
    move_back(group, last, left, right, aside);
  }

 private:
  PALPATE_AVX2 static __m256i positions(unsigned mask) noexcept {
    return _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(static_cast<long long>(kLanePositions[mask])));
  }
  PALPATE_AVX2 static void put(std::uint32_t* into, __m256i lanes) noexcept {
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(into), lanes);
  }
  /// Whole lanes, except the last, beyond which other data follows.
  PALPATE_AVX2 static void move_back(SplitGroup& group, std::size_t last, std::size_t left, std::size_t right,
                                     const Aside& aside) noexcept {
    std::size_t k = 0;
    for (; left + k + kLanes <= last && k < right; k += kLanes) {
      for (std::size_t axis = 0; axis < 3; ++axis)
        _mm256_storeu_ps(&group.at[axis][left + k], _mm256_loadu_ps(&aside.at[axis][k]));
      put(&group.index[left + k], _mm256_loadu_si256(reinterpret_cast<const __m256i*>(&aside.index[k])));
    }
    for (; k < right; ++k) {
      for (std::size_t axis = 0; axis < 3; ++axis) group.at[axis][left + k] = aside.at[axis][k];
      group.index[left + k] = aside.index[k];
    }
  }
};

PALPATE_AVX2 void split_at_medians_avx2(SplitGroup& group) noexcept {
  split_all_at_medians(
      group, [](SplitGroup& g, std::size_t first, std::size_t last, const Keys& key, std::int32_t bound,
                Aside& aside) { Wide::part(g, first, last, key, bound, aside); });
}
#endif

}  // namespace

void split_at_medians_scalar(SplitGroup& group) noexcept {
  split_all_at_medians(
      group, [](SplitGroup& g, std::size_t first, std::size_t last, const Keys& key, std::int32_t bound,
                Aside& aside) { Narrow::part(g, first, last, key, bound, aside); });
}

void split_at_medians(SplitGroup& group) noexcept {
#if defined(__x86_64__)
  if (has_avx2()) {
    split_at_medians_avx2(group);
    return;
  }
#endif
  split_at_medians_scalar(group);
}

}  // namespace palpate::local_delaunay
