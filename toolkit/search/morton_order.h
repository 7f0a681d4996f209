// Points sorted along a Morton curve, for grids and neighbour builders. Points near in space are near in
// memory, and every cube of the octree hierarchy is a contiguous range.
#pragma once

#include <cstdint>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>

namespace palpate::search {

/// Bits per axis of a Morton code. A float has 24 mantissa bits; finer cells would separate nothing.
inline constexpr int kMortonBits = 21;

/// Interleaves the low 21 bits of x, y, z: bit i of x at 3i, of y at 3i + 1, of z at 3i + 2.
[[nodiscard]] std::uint64_t morton_code(std::uint32_t x, std::uint32_t y, std::uint32_t z) noexcept;

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

}  // namespace palpate::search
