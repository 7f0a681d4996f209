// Voxels and the cubes of 4 x 4 x 4 of them that bricks are of. Places in voxels from the lattice's corner.
#pragma once

#include <cstdint>

#include "toolkit/core/vec.h"
#include "toolkit/smooth/brick_grid.h"
#include "toolkit/smooth/spline.h"

namespace palpate::render {

/// Of a brick's mask: the cell of a place in its cube.
[[nodiscard]] inline std::uint64_t mask_bit(const BrickPlace& at) noexcept {
  return std::uint64_t{1} << ((at.cell[0] * kBrickCells + at.cell[1]) * kBrickCells + at.cell[2]);
}

/// The voxel that a place lies in: its cube and its cell there are bits of one number.
using Voxel = BrickGrid::Coordinate;
static_assert(kBrickCells == 1 << 2);
[[nodiscard]] inline Voxel voxel_of(const Vec3& at) noexcept {
  Voxel out;
  for (std::size_t a = 0; a < 3; ++a) {
    const double x = at[static_cast<Eigen::Index>(a)];
    const auto whole = static_cast<std::int32_t>(x);
    out[a] = whole - static_cast<std::int32_t>(static_cast<double>(whole) > x);
  }
  return out;
}
[[nodiscard]] inline BrickGrid::Coordinate cube_around(const Voxel& v) noexcept {
  return {v[0] >> 2, v[1] >> 2, v[2] >> 2};
}
[[nodiscard]] inline bool is_in(const Voxel& v, const BrickGrid::Coordinate& cube) noexcept {
  return (((v[0] >> 2) ^ cube[0]) | ((v[1] >> 2) ^ cube[1]) | ((v[2] >> 2) ^ cube[2])) == 0;
}
/// In the brick of its cube.
[[nodiscard]] inline BrickPlace place_in_voxel(const Voxel& v, const Vec3& at) noexcept {
  return {
      {v[0] & 3, v[1] & 3, v[2] & 3},
      {static_cast<float>(at[0] - v[0]), static_cast<float>(at[1] - v[1]), static_cast<float>(at[2] - v[2])}};
}
[[nodiscard]] inline std::uint64_t mask_bit_of(const Voxel& v) noexcept {
  return std::uint64_t{1} << ((v[0] & 3) << 4 | (v[1] & 3) << 2 | (v[2] & 3));
}

}  // namespace palpate::render
