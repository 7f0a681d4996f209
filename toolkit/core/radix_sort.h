// Parallel radix sort.
#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "toolkit/core/parallel.h"

namespace palpate {

/// Stable sort by the lowest `bits` bits of key(item). O(n) per 11 bits; needs a second copy of the items.
/// Independent of the number of threads.
template <class Items, class Key>
void radix_sort(Items& items, int bits, int threads, Key&& key) {
  using Item = typename Items::value_type;
  constexpr int kDigitBits = 11;  // 2048 counters stay in the first-level cache
  constexpr std::uint32_t kDigits = 1u << kDigitBits;
  // Small enough to balance two threads, large enough to pay for its counters.
  constexpr std::size_t kChunk = std::size_t{1} << 16;
  const std::size_t n = items.size();
  Items other(n);
  std::vector<std::array<std::uint32_t, kDigits>> counts((n + kChunk - 1) / kChunk);
  for (int shift = 0; shift < bits; shift += kDigitBits) {
    const auto digit = [&](const Item& item) { return (key(item) >> shift) & (kDigits - 1); };
    parallel_chunks(n, kChunk, threads, [&](std::size_t begin, std::size_t end) {
      auto& count = counts[begin / kChunk];
      count.fill(0);
      for (std::size_t i = begin; i < end; ++i) ++count[digit(items[i])];
    });
    std::uint32_t sum = 0;
    for (std::uint32_t d = 0; d < kDigits; ++d)
      for (auto& count : counts) sum += std::exchange(count[d], sum);
    parallel_chunks(n, kChunk, threads, [&](std::size_t begin, std::size_t end) {
      auto& place = counts[begin / kChunk];
      for (std::size_t i = begin; i < end; ++i) other[place[digit(items[i])]++] = items[i];
    });
    items.swap(other);
  }
}

}  // namespace palpate
