// All parallelism of preparation goes through parallel_chunks(). It runs on oneTBB, or on std::thread where
// PALPATE_STD_THREADS is defined: ThreadSanitizer cannot see oneTBB's synchronisation, so its build uses the
// latter and needs no suppressions.
//
// Determinism: a result must not depend on `threads`. Give every index its own output, or reduce over fixed
// chunks in index order.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace palpate {

/// Points per chunk in passes with little work each: large enough to hide the hand-over, small enough for
/// about sixty chunks per million. The number does not affect results.
inline constexpr std::size_t kPointsPerChunk = 16384;

/// Calls body(begin, end) for consecutive chunks of at most `grain` covering [0, count), on up to `threads`
/// threads (0 = all; at most the machine's). Chunk borders depend on `grain` only. Returns when all are done.
/// body must not throw.
void parallel_chunks(std::size_t count, std::size_t grain, int threads,
                     const std::function<void(std::size_t begin, std::size_t end)>& body);

/// The same with body(i) for every index of [0, count).
template <class Index = std::size_t, class Body>
void parallel_each(std::size_t count, std::size_t grain, int threads, const Body& body) {
  parallel_chunks(count, grain, threads, [&body](std::size_t begin, std::size_t end) {
    for (auto i = static_cast<Index>(begin); i < end; ++i) body(i);
  });
}

/// One Part per chunk, in order: for sums over fixed chunks. body(begin, end, part) fills it, or body(i,
/// part) for every index of the chunk.
template <class Part, class Body>
[[nodiscard]] std::vector<Part> parallel_parts(std::size_t count, std::size_t grain, int threads,
                                               const Body& body) {
  std::vector<Part> parts((count + grain - 1) / grain);
  parallel_chunks(count, grain, threads, [&](std::size_t begin, std::size_t end) {
    Part& part = parts[begin / grain];
    if constexpr (std::is_invocable_v<const Body&, std::size_t, std::size_t, Part&>)
      body(begin, end, part);
    else
      for (std::size_t i = begin; i < end; ++i) body(i, part);
  });
  return parts;
}

/// The items that body(begin, end, items) appends for each chunk, or body(i, items) for every index, in
/// order.
template <class Item, class Body>
[[nodiscard]] std::vector<Item> parallel_list(std::size_t count, std::size_t grain, int threads,
                                              const Body& body) {
  auto parts = parallel_parts<std::vector<Item>>(count, grain, threads, body);
  std::size_t size = 0;
  for (const std::vector<Item>& part : parts) size += part.size();
  std::vector<Item> items;
  items.reserve(size);
  for (std::vector<Item>& part : parts) {
    items.insert(items.end(), part.begin(), part.end());
    std::vector<Item>().swap(part);
  }
  return items;
}

/// The number of threads for 0.
[[nodiscard]] int available_threads() noexcept;

/// Ends idle worker threads before a fork: the child has only the forking thread and would wait for them for
/// ever. They return with the next work. False if some are busy, or if this build cannot be forked
/// (ThreadSanitizer).
[[nodiscard]] bool stop_idle_workers();

/// Name and version of the loaded parallel runtime.
[[nodiscard]] std::pair<std::string, std::string> parallel_library();

/// Stable parallel sort by the lowest `bits` bits of key(item). O(n) per 11 bits; needs a second copy of the
/// items. Independent of the number of threads.
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
