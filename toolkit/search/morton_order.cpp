#include "toolkit/search/morton_order.h"

#include <algorithm>
#include <array>
#include <bit>

#include "toolkit/core/parallel.h"

namespace palpate::search {
namespace {

/// Points per chunk: small enough to balance two threads.
constexpr std::size_t kChunk = std::size_t{1} << 16;

std::uint64_t spread(std::uint64_t x) noexcept {
  x &= 0x1FFFFFu;
  x = (x | x << 32) & 0x001F00000000FFFFu;
  x = (x | x << 16) & 0x001F0000FF0000FFu;
  x = (x | x << 8) & 0x100F00F00F00F00Fu;
  x = (x | x << 4) & 0x10C30C30C30C30C3u;
  return (x | x << 2) & 0x1249249249249249u;
}

/// Every third bit of a Morton code, moved together: the inverse of morton_code's spreading.
std::uint32_t compact(std::uint64_t x) noexcept {
  x &= 0x1249249249249249u;
  x = (x | x >> 2) & 0x10C30C30C30C30C3u;
  x = (x | x >> 4) & 0x100F00F00F00F00Fu;
  x = (x | x >> 8) & 0x001F0000FF0000FFu;
  x = (x | x >> 16) & 0x001F00000000FFFFu;
  return static_cast<std::uint32_t>((x | x >> 32) & 0x1FFFFFu);
}

struct Item {
  std::uint64_t code;
  std::uint32_t index;
};
}  // namespace

std::uint64_t morton_code(std::uint32_t x, std::uint32_t y, std::uint32_t z) noexcept {
  return spread(x) | spread(y) << 1 | spread(z) << 2;
}

std::array<std::int32_t, 3> coordinate_of_code(std::uint64_t code) noexcept {
  return {static_cast<std::int32_t>(compact(code)), static_cast<std::int32_t>(compact(code >> 1)),
          static_cast<std::int32_t>(compact(code >> 2))};
}

geometry::Aabb local_box(const cloud::Cloud& cloud, int threads) {
  const auto add = [&](std::size_t i, geometry::Aabb& box) { box.add(cloud.local_mm(i)); };
  geometry::Aabb box;
  for (const auto& part : parallel_parts<geometry::Aabb>(cloud.size(), kChunk, threads, add)) {
    box.add(part.low_mm);
    box.add(part.high_mm);
  }
  return box;
}

Lattice Lattice::over(const geometry::Aabb& local_box_mm, double unit_mm) {
  const double extent = local_box_mm.extent_mm().maxCoeff();
  constexpr double kMaxCubes =
      static_cast<double>((1u << kMortonBits) - 2);  // one spare for rounding at the far face
  while (extent / unit_mm > kMaxCubes) unit_mm *= 2.0;
  return {local_box_mm.low_mm, unit_mm, 1.0 / unit_mm};
}

namespace {

std::uint64_t code_at(const cloud::Cloud& cloud, std::size_t i, const Lattice& lattice) noexcept {
  const Vec3 p = cloud.local_mm(i);
  return morton_code(static_cast<std::uint32_t>(lattice.coordinate(p.x(), 0)),
                     static_cast<std::uint32_t>(lattice.coordinate(p.y(), 1)),
                     static_cast<std::uint32_t>(lattice.coordinate(p.z(), 2)));
}

int bits_of(std::uint64_t all) noexcept {
  return 64 - std::countl_zero(all);
}

/// Fills items[i] = make(code, i); returns the union of bits.
template <class Sorted, class Make>
std::uint64_t encode(const cloud::Cloud& cloud, const Lattice& lattice, std::vector<Sorted>& items,
                     int threads, Make&& make) {
  items.resize(cloud.size());
  const auto used =
      parallel_parts<std::uint64_t>(cloud.size(), kChunk, threads, [&](std::size_t i, std::uint64_t& any) {
        const std::uint64_t code = code_at(cloud, i, lattice);
        items[i] = make(code, i);
        any |= code;
      });
  std::uint64_t all = 0;
  for (const std::uint64_t u : used) all |= u;
  return all;
}

}  // namespace

std::vector<std::uint32_t> sorted_coarse_codes(const cloud::Cloud& cloud, const Lattice& lattice,
                                               int threads) {
  std::vector<std::uint32_t> codes;
  const std::uint64_t all = encode(cloud, lattice, codes, threads, [](std::uint64_t code, std::size_t) {
    return static_cast<std::uint32_t>(code);
  });
  radix_sort(codes, bits_of(all), threads, [](std::uint32_t code) { return code; });
  return codes;
}

MortonOrder sort_by_morton(const cloud::Cloud& cloud, const Lattice& lattice, int threads, int axes) {
  const std::size_t n = cloud.size();
  std::vector<Item> items;
  const std::uint64_t kept = axes == 3 ? ~std::uint64_t{0} : ~(spread(~std::uint64_t{0}) << 2);
  const std::uint64_t all = encode(cloud, lattice, items, threads, [kept](std::uint64_t code, std::size_t i) {
    return Item{code & kept, static_cast<std::uint32_t>(i)};
  });
  radix_sort(items, bits_of(all), threads, [](const Item& item) { return item.code; });
  MortonOrder sorted;
  sorted.codes.resize(n);
  sorted.order.resize(n);
  parallel_each(n, kChunk, threads, [&](std::size_t i) {
    sorted.codes[i] = items[i].code;
    sorted.order[i] = items[i].index;
  });
  return sorted;
}

void MortonCellTable::build(std::span<const std::uint64_t> codes) {
  if (codes.empty()) return;
  std::size_t blocks = 1;
  for (std::size_t i = 1; i < codes.size(); ++i) blocks += codes[i] >> kBits != codes[i - 1] >> kBits;
  const std::size_t size = std::bit_ceil(blocks * 2);
  slots_.assign(size, Slot{});
  mask_ = size - 1;
  shift_ = 64 - std::countr_zero(size);
  for (std::size_t i = 0; i < codes.size();) {
    const std::uint64_t block = codes[i] >> kBits;
    std::size_t at = slot(block);
    while (slots_[at].cells != 0) at = (at + 1) & mask_;
    Slot& here = slots_[at];
    here.block = block;
    here.first = static_cast<std::uint32_t>(i);
    for (; i < codes.size() && codes[i] >> kBits == block; ++i)
      here.cells |= std::uint64_t{1} << (codes[i] & (kCells - 1));
  }
}

std::vector<std::uint64_t> MortonCellTable::codes(std::size_t cells) const {
  std::vector<std::uint64_t> out(cells, 0);
  for (const Slot& slot : slots_) {
    std::size_t at = slot.first;
    for (std::uint64_t left = slot.cells; left != 0; left &= left - 1)
      out[at++] = slot.block << kBits | static_cast<std::uint64_t>(std::countr_zero(left));
  }
  return out;
}

}  // namespace palpate::search
