// Groups items by key with a counting sort: facets around each vertex, facets of each lowest vertex.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"

namespace palpate::baselines {

/// Items of key k, ascending: items[begin[k]] to items[begin[k + 1]].
struct Buckets {
  LargePageUninitializedVector<std::uint32_t> begin, items;
};

/// keys_of(item, visit) calls visit(key), key < `keys`, for each key of an item < `count`; it runs twice, in
/// several threads. O(count + keys) for bounded buckets, at worst O(n log n). Buckets are sorted, so results
/// do not depend on `threads`.
template <class KeysOf>
[[nodiscard]] Buckets group_by_key(std::size_t keys, std::size_t count, int threads, const KeysOf& keys_of) {
  using Slot = std::atomic_ref<std::uint32_t>;
  constexpr auto kRelaxed = std::memory_order_relaxed;  // each pass ends with a join of the threads
  Buckets made;
  made.begin.resize(keys + 1);
  std::fill(made.begin.begin(), made.begin.end(), 0u);
  const auto for_items = [&](const auto& visit) {
    parallel_each(count, kPointsPerChunk, threads, [&](std::size_t item) {
      keys_of(item, [&](std::uint32_t key) { visit(static_cast<std::uint32_t>(item), key); });
    });
  };
  // Holds bucket ends first; filling from the back turns them into beginnings.
  for_items([&](std::uint32_t, std::uint32_t key) { Slot(made.begin[key]).fetch_add(1, kRelaxed); });
  std::uint32_t sum = 0;
  for (std::uint32_t& end : made.begin) end = sum += end;
  made.items.resize(sum);
  for_items([&](std::uint32_t item, std::uint32_t key) {
    made.items[Slot(made.begin[key]).fetch_sub(1, kRelaxed) - 1] = item;
  });
  parallel_each(keys, kPointsPerChunk, threads, [&](std::size_t key) {
    std::sort(made.items.begin() + made.begin[key], made.items.begin() + made.begin[key + 1]);
  });
  return made;
}

}  // namespace palpate::baselines
