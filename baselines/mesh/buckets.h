// Items under keys, by counting: the facets around each vertex, the facets of each lowest vertex.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "baselines/mesh/unfilled.h"
#include "toolkit/core/parallel.h"

namespace palpate::baselines {

/// Those of key k: items[begin[k]] to items[begin[k + 1]], ascending.
struct Buckets {
  UnfilledVector<std::uint32_t> begin, items;
};

/// keys_of(item, visit) calls visit(key) for each key, below `keys`, of an item below `count`; it is called
/// twice and from several threads. O(count + keys) for buckets of bounded size, O(n log n) at worst. The same
/// for any number of threads: they race for places in a bucket, which is then sorted.
template <class KeysOf>
[[nodiscard]] Buckets in_buckets(std::size_t keys, std::size_t count, int threads, const KeysOf& keys_of) {
  using Slot = std::atomic_ref<std::uint32_t>;
  constexpr auto kRelaxed = std::memory_order_relaxed;  // threads meet at the end of each pass
  Buckets made;
  made.begin.resize(keys + 1);
  std::fill(made.begin.begin(), made.begin.end(), 0u);
  const auto for_items = [&](const auto& visit) {
    parallel_chunks(count, kPointsPerChunk, threads, [&](std::size_t from, std::size_t to) {
      for (std::size_t item = from; item < to; ++item)
        keys_of(item, [&](std::uint32_t key) { visit(static_cast<std::uint32_t>(item), key); });
    });
  };
  // First the end of each bucket; filling from the back makes it the beginning.
  for_items([&](std::uint32_t, std::uint32_t key) { Slot(made.begin[key]).fetch_add(1, kRelaxed); });
  std::uint32_t sum = 0;
  for (std::uint32_t& end : made.begin) end = sum += end;
  made.items.resize(sum);
  for_items([&](std::uint32_t item, std::uint32_t key) {
    made.items[Slot(made.begin[key]).fetch_sub(1, kRelaxed) - 1] = item;
  });
  parallel_chunks(keys, kPointsPerChunk, threads, [&](std::size_t from, std::size_t to) {
    for (std::size_t key = from; key < to; ++key)
      std::sort(made.items.begin() + made.begin[key], made.items.begin() + made.begin[key + 1]);
  });
  return made;
}

}  // namespace palpate::baselines
