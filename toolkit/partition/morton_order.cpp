#include "toolkit/partition/morton_order.h"

#include <algorithm>
#include <array>
#include <bit>

#include "toolkit/core/parallel.h"

namespace palpate::partition {
namespace {

/// 11 bits: a histogram of 2048 counters stays in the first-level cache.
constexpr int kDigitBits = 11;
constexpr std::size_t kDigits = std::size_t{1} << kDigitBits;
/// Points a chunk: small enough for two threads to balance, large enough to pay for its histogram.
constexpr std::size_t kChunk = std::size_t{1} << 16;

std::uint64_t spread(std::uint64_t x) noexcept {
  x &= 0x1FFFFFu;
  x = (x | x << 32) & 0x001F00000000FFFFu;
  x = (x | x << 16) & 0x001F0000FF0000FFu;
  x = (x | x << 8) & 0x100F00F00F00F00Fu;
  x = (x | x << 4) & 0x10C30C30C30C30C3u;
  return (x | x << 2) & 0x1249249249249249u;
}

struct Item {
  std::uint64_t code;
  std::uint32_t index;
};

/// One stable counting pass over `shift`..`shift + kDigitBits`. Chunk borders do not depend on the threads.
void radix_pass(const std::vector<Item>& from, std::vector<Item>& to, int shift, int threads) {
  const std::size_t n = from.size();
  const std::size_t chunks = (n + kChunk - 1) / kChunk;
  std::vector<std::array<std::uint32_t, kDigits>> counts(chunks);
  parallel_chunks(n, kChunk, threads, [&](std::size_t begin, std::size_t end) {
    auto& count = counts[begin / kChunk];
    count.fill(0);
    for (std::size_t i = begin; i < end; ++i) ++count[(from[i].code >> shift) & (kDigits - 1)];
  });
  std::uint32_t sum = 0;
  for (std::size_t digit = 0; digit < kDigits; ++digit) {
    for (auto& count : counts) {
      const std::uint32_t here = count[digit];
      count[digit] = sum;
      sum += here;
    }
  }
  parallel_chunks(n, kChunk, threads, [&](std::size_t begin, std::size_t end) {
    auto& place = counts[begin / kChunk];
    for (std::size_t i = begin; i < end; ++i) to[place[(from[i].code >> shift) & (kDigits - 1)]++] = from[i];
  });
}

}  // namespace

std::uint64_t morton_code(std::uint32_t x, std::uint32_t y, std::uint32_t z) noexcept {
  return spread(x) | spread(y) << 1 | spread(z) << 2;
}

Lattice Lattice::over(const cloud::Cloud& cloud, double unit_mm) {
  geometry::Aabb box;
  for (std::size_t i = 0; i < cloud.size(); ++i) box.add(cloud.local_mm(i));
  const double extent = box.extent_mm().maxCoeff();
  constexpr double kMaxCubes =
      static_cast<double>((1u << kMortonBits) - 2);  // one spare for rounding at the far face
  while (extent / unit_mm > kMaxCubes) unit_mm *= 2.0;
  return {box.low_mm, unit_mm, 1.0 / unit_mm};
}

MortonOrder sort_by_morton(const cloud::Cloud& cloud, const Lattice& lattice, int threads) {
  const std::size_t n = cloud.size();
  std::vector<Item> items(n);
  const std::size_t chunks = (n + kChunk - 1) / kChunk;
  std::vector<std::uint64_t> used(chunks, 0);
  parallel_chunks(n, kChunk, threads, [&](std::size_t begin, std::size_t end) {
    std::uint64_t any = 0;
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3 p = cloud.local_mm(i);
      items[i] = {morton_code(static_cast<std::uint32_t>(lattice.coordinate(p.x(), 0)),
                              static_cast<std::uint32_t>(lattice.coordinate(p.y(), 1)),
                              static_cast<std::uint32_t>(lattice.coordinate(p.z(), 2))),
                  static_cast<std::uint32_t>(i)};
      any |= items[i].code;
    }
    used[begin / kChunk] = any;
  });
  std::uint64_t all = 0;
  for (const std::uint64_t u : used) all |= u;
  const int bits = 64 - std::countl_zero(all);
  std::vector<Item> other(n);
  for (int shift = 0; shift < bits; shift += kDigitBits) {
    radix_pass(items, other, shift, threads);
    items.swap(other);
  }
  MortonOrder sorted;
  sorted.codes.resize(n);
  sorted.order.resize(n);
  parallel_chunks(n, kChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      sorted.codes[i] = items[i].code;
      sorted.order[i] = items[i].index;
    }
  });
  return sorted;
}

}  // namespace palpate::partition
