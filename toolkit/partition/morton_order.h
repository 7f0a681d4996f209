// Points sorted along a Morton curve: what the grid and the neighbour builders start from. Points near in
// space are near in memory, and every cube of the octree hierarchy is one contiguous range.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/geometry/aabb.h"

namespace palpate::partition {

/// Bits per axis of a Morton code. A float has 24 bits of mantissa, so finer cells would divide nothing.
inline constexpr int kMortonBits = 21;

/// Interleaves the low 21 bits of x, y, z: bit i of x at 3i, of y at 3i + 1, of z at 3i + 2.
[[nodiscard]] std::uint64_t morton_code(std::uint32_t x, std::uint32_t y, std::uint32_t z) noexcept;

/// A lattice of cubes over a cloud, in the cloud's local coordinates.
struct Lattice {
  Vec3 low_mm = Vec3::Zero();  ///< corner of cube (0, 0, 0)
  double unit_mm = 1.0;        ///< cube edge
  double per_mm = 1.0;         ///< 1 / unit_mm

  /// The lattice of cubes of `unit_mm` anchored at the cloud's low corner; the edge is doubled until the
  /// cloud spans fewer than 2^21 cubes per axis.
  static Lattice over(const geometry::Aabb& local_box_mm, double unit_mm);
  /// Cube coordinate along one axis; points of the cloud give 0 .. 2^21 - 1.
  [[nodiscard]] std::int64_t coordinate(double local_mm, int axis) const noexcept {
    const double cubes = (local_mm - low_mm[axis]) * per_mm;
    // Far outside the lattice the conversion would overflow; such places have no cube anyway.
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
  std::vector<std::uint32_t> order;  ///< cloud index of each place; equal codes keep the cloud's order
};

/// Sorts by Morton code of the lattice's cubes, or of its columns along z (`axes` = 2: the bits of z are 0).
/// O(n) radix sort, parallel, the same for any number of threads.
[[nodiscard]] MortonOrder sort_by_morton(const cloud::Cloud& cloud, const Lattice& lattice, int threads,
                                         int axes = 3);

/// Only the codes, ascending, of a lattice that the cloud spans at most 1024 cubes of per axis.
[[nodiscard]] std::vector<std::uint32_t> sorted_coarse_codes(const cloud::Cloud& cloud,
                                                             const Lattice& lattice, int threads);

}  // namespace palpate::partition
