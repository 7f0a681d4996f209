// Points sorted along a Morton curve, and occupied cubes. Grids and neighbour builders use them. Points near
// in space are near in memory, and every cube of the octree hierarchy is a contiguous range.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include "toolkit/core/hash.h"

namespace palpate::search {

/// Bits per axis of a Morton code. A float has 24 mantissa bits; finer cells would separate nothing.
inline constexpr int kMortonBits = 21;

/// Interleaves the low 21 bits of x, y, z: bit i of x at 3i, of y at 3i + 1, of z at 3i + 2.
[[nodiscard]] std::uint64_t morton_code(std::uint32_t x, std::uint32_t y, std::uint32_t z) noexcept;
/// The lattice coordinate of a Morton code.
[[nodiscard]] std::array<std::int32_t, 3> coordinate_of_code(std::uint64_t code) noexcept;

/// The code's bits of one axis for the next coordinate along it. Borrows pass over the bits between.
template <int kAxis>
[[nodiscard]] constexpr std::uint64_t next_code(std::uint64_t code) noexcept {
  constexpr std::uint64_t kBits = 0x1249249249249249ull << kAxis;  // every third of 21 bits
  return (code - kBits) & kBits;
}

/// Calls visit(code) for every cell of a box, both ends included; coordinates below 2^21. Along x first.
template <class Visit>
void visit_codes(const std::array<std::int64_t, 3>& low, const std::array<std::int64_t, 3>& high,
                 Visit&& visit) {
  const auto first = [&](std::size_t axis) { return static_cast<std::uint32_t>(low[axis]); };
  const std::uint64_t code_x = morton_code(first(0), 0, 0), code_y = morton_code(0, first(1), 0);
  std::uint64_t cz = morton_code(0, 0, first(2));
  for (std::int64_t z = low[2]; z <= high[2]; ++z, cz = next_code<2>(cz)) {
    std::uint64_t cy = code_y;
    for (std::int64_t y = low[1]; y <= high[1]; ++y, cy = next_code<1>(cy)) {
      std::uint64_t cx = code_x;
      for (std::int64_t x = low[0]; x <= high[0]; ++x, cx = next_code<0>(cx)) visit(cx | cy | cz);
    }
  }
}

/// A lattice of cubes over a cloud, in local coordinates.
struct Lattice {
  Vec3 low_mm = Vec3::Zero();  ///< corner of cube (0, 0, 0)
  double unit_mm = 1.0;        ///< cube edge
  double per_mm = 1.0;         ///< 1 / unit_mm

  /// Cubes of `unit_mm` from the cloud's low corner; doubled until the cloud spans under 2^21 cubes per axis.
  static Lattice over(const geometry::Aabb& local_box_mm, double unit_mm);
  /// Cube coordinate along one axis; 0 .. 2^21 - 1 for the cloud's points.
  [[nodiscard]] std::int64_t coordinate(double local_mm, int axis) const noexcept {
    const double cubes = (local_mm - low_mm[axis]) * per_mm;
    // Farther out the conversion would overflow; no cube is there.
    constexpr double kFar = 1099511627776.0;  // 2^40, beyond any of the 2^21 cubes
    if (!(cubes > -kFar)) return -static_cast<std::int64_t>(kFar);
    if (!(cubes < kFar)) return static_cast<std::int64_t>(kFar);
    const auto truncated = static_cast<std::int64_t>(cubes);
    return truncated - (static_cast<double>(truncated) > cubes ? 1 : 0);
  }
};

/// The box of a cloud's local coordinates. Parallel.
[[nodiscard]] geometry::Aabb local_box(const cloud::Cloud& cloud, int threads);

struct MortonOrder {
  std::vector<std::uint64_t> codes;  ///< ascending
  std::vector<std::uint32_t> order;  ///< cloud index per place; equal codes keep the cloud's order
};

/// Sorts by Morton code of the lattice's cubes, or of its columns along z (`axes` = 2: z bits are 0).
/// Parallel O(n) radix sort, independent of the number of threads.
[[nodiscard]] MortonOrder sort_by_morton(const cloud::Cloud& cloud, const Lattice& lattice, int threads,
                                         int axes = 3);

/// The ascending codes only, for a lattice of at most 1024 cubes per axis.
[[nodiscard]] std::vector<std::uint32_t> sorted_coarse_codes(const cloud::Cloud& cloud,
                                                             const Lattice& lattice, int threads);

/// Maps a cell's Morton code to its number. Immutable once built.
class MortonCellTable {
 public:
  static constexpr std::uint32_t kNone = 0xffffffffu;
  /// `codes` ascend; a cell's number is its index among them. O(cells).
  void build(std::span<const std::uint64_t> codes);
  [[nodiscard]] std::uint32_t find(std::uint64_t code) const noexcept {
    if (slots_.empty()) return kNone;
    const std::uint64_t block = code >> kBits;
    for (std::size_t i = slot(block);; i = (i + 1) & mask_) {
      const Slot& here = slots_[i];
      if (here.block != block && here.cells != 0) continue;
      const std::uint64_t bit = std::uint64_t{1} << (code & (kCells - 1));
      return (here.cells & bit) != 0 ? here.first + count(here.cells & (bit - 1)) : kNone;
    }
  }
  /// The codes of all cells. O(cells).
  [[nodiscard]] std::vector<std::uint64_t> codes(std::size_t cells) const;
  [[nodiscard]] std::size_t bytes() const noexcept { return slots_.capacity() * sizeof(Slot); }

 private:
  static constexpr int kBits = 6;
  static constexpr std::uint64_t kCells = std::uint64_t{1} << kBits;
  struct Slot {
    std::uint64_t block = 0;
    std::uint64_t cells = 0;  ///< a bit per cell; 0: no block
    std::uint32_t first = 0;  ///< number of the lowest
  };
  /// Portable population count: no other code here requires POPCNT.
  [[nodiscard]] static std::uint32_t count(std::uint64_t x) noexcept {
    x -= x >> 1 & 0x5555555555555555u;
    x = (x & 0x3333333333333333u) + (x >> 2 & 0x3333333333333333u);
    x = (x + (x >> 4)) & 0x0f0f0f0f0f0f0f0fu;
    return static_cast<std::uint32_t>(x * 0x0101010101010101u >> 56);
  }
  [[nodiscard]] std::size_t slot(std::uint64_t block) const noexcept {
    return static_cast<std::size_t>((block * kGolden64) >> shift_) & mask_;
  }
  std::vector<Slot> slots_;
  std::size_t mask_ = 0;
  int shift_ = 0;
};

}  // namespace palpate::search
