// Evaluates a brick's uniform cubic B-spline: value, gradient and second derivatives.
#pragma once

#include <palpate/vec.h>
#include <array>
#include <cstdint>

#include "toolkit/spline_sdf/brick_grid.h"

namespace palpate::render {

/// The evaluation at a place, in voxels.
struct Jet {
  float value = 0.0f;
  Eigen::Vector3f gradient = Eigen::Vector3f::Zero();
  /// xx, yy, zz, xy, xz, yz
  std::array<float, 6> second{};
};

/// A place in a brick: cell and fraction.
struct BrickPosition {
  std::array<int, 3> cell{};
  std::array<float, 3> t{};
};

/// Reads 16 rows of four coefficients, eight floats at a time with AVX2 (has_avx2()), bit-identical without.
/// Thread-safe.
[[nodiscard]] Jet spline_jet(const Brick& brick, const BrickPosition& at) noexcept;
/// The value only, bit-identical to jet.value.
[[nodiscard]] float spline_value(const Brick& brick, const BrickPosition& at) noexcept;

/// The four-lane form, for tests.
[[nodiscard]] Jet narrow_spline_jet(const Brick& brick, const BrickPosition& at) noexcept;
[[nodiscard]] float narrow_spline_value(const Brick& brick, const BrickPosition& at) noexcept;

/// The mask bit of a place's cell in its cube.
[[nodiscard]] inline std::uint64_t mask_bit(const BrickPosition& at) noexcept {
  return std::uint64_t{1} << ((at.cell[0] * kBrickCells + at.cell[1]) * kBrickCells + at.cell[2]);
}

/// The voxel of a place: cube and cell are bits of one number.
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
[[nodiscard]] inline bool is_in(const Voxel& v, const BrickGrid::Coordinate& cube) noexcept {
  return (((v[0] >> 2) ^ cube[0]) | ((v[1] >> 2) ^ cube[1]) | ((v[2] >> 2) ^ cube[2])) == 0;
}
/// The place in its cube's brick.
[[nodiscard]] inline BrickPosition place_in_voxel(const Voxel& v, const Vec3& at) noexcept {
  return {
      {v[0] & 3, v[1] & 3, v[2] & 3},
      {static_cast<float>(at[0] - v[0]), static_cast<float>(at[1] - v[1]), static_cast<float>(at[2] - v[2])}};
}
[[nodiscard]] inline std::uint64_t mask_bit_of(const Voxel& v) noexcept {
  return std::uint64_t{1} << ((v[0] & 3) << 4 | (v[1] & 3) << 2 | (v[2] & 3));
}

}  // namespace palpate::render
