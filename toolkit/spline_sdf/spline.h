// The spline in a brick, and Newton steps on it. The spline gives values, gradients and second derivatives; a
// Newton step moves the god object to its zero set.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include <palpate/vec.h>
#include "toolkit/spline_sdf/brick_grid.h"

namespace palpate::spline_sdf {

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

/// Lower bound on the distance's curvature along the surface; below it the god object is at a saddle and
/// Newton's step is arbitrary.
inline constexpr double kMinCurvature = 0.2;

/// One Newton step to the nearest place to h on the level set through `at`. Without `exact` it uses the
/// Hessian of a plane.
struct NewtonStep {
  Vec3 along = Vec3::Zero();   ///< the tangent plane
  Vec3 normal = Vec3::Zero();  ///< unit, of growing distance
  double lift = 0.0;           ///< along the normal, back to the surface
};

[[nodiscard, gnu::always_inline]] inline NewtonStep newton_step(const Jet& jet, const Vec3& d, double longest,
                                                                bool exact = true) noexcept {
  NewtonStep s;
  const Vec3 g = jet.gradient.cast<double>();
  const double size_sq = g.squaredNorm();
  if (!(size_sq > 0.0)) return s;
  const double size = std::sqrt(size_sq), per = 1.0 / size;
  const Vec3 n = g * per;
  s.normal = n;
  const double depth = d.dot(n);
  const Vec3 t = d - n * depth;
  // Tangents (Duff et al. 2017).
  const double sign = std::copysign(1.0, n.z()), a = -1.0 / (sign + n.z()), b = n.x() * n.y() * a;
  const Vec3 e(1.0 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()),
      f(b, sign + n.y() * n.y() * a, -n.y());
  const auto second = [&](const Vec3& v) {
    const auto& h = jet.second;
    const double xx = static_cast<double>(h[0]), yy = static_cast<double>(h[1]),
                 zz = static_cast<double>(h[2]);
    const double xy = static_cast<double>(h[3]), xz = static_cast<double>(h[4]),
                 yz = static_cast<double>(h[5]);
    return Vec3(xx * v.x() + xy * v.y() + xz * v.z(), xy * v.x() + yy * v.y() + yz * v.z(),
                xz * v.x() + yz * v.y() + zz * v.z());
  };
  const Vec3 he = second(e), hf = second(f);
  const double ee = e.dot(he), ef = f.dot(he), ff = f.dot(hf);
  const double lambda = exact ? depth * per : 0.0;
  double p = 1.0 + lambda * ee, q = lambda * ef, r = 1.0 + lambda * ff;
  const double middle = 0.5 * (p + r), half = 0.5 * (p - r);
  double determinant = p * r - q * q;
  if (!(middle > kMinCurvature && determinant > kMinCurvature * middle)) {
    const double least = middle - std::sqrt(half * half + q * q);
    const double lift = std::max(kMinCurvature - least, 0.0);
    p += lift;
    r += lift;
    determinant = p * r - q * q;
  }
  const double te = t.dot(e), tf = t.dot(f);
  double x = (r * te - q * tf) / determinant, y = (p * tf - q * te) / determinant;
  const double length_sq = x * x + y * y;
  if (length_sq > longest * longest) {
    const double share = longest / std::sqrt(length_sq);
    x *= share;
    y *= share;
  }
  s.along = e * x + f * y;
  s.lift = -(static_cast<double>(jet.value) + 0.5 * (x * x * ee + 2.0 * x * y * ef + y * y * ff)) * per;
  return s;
}

}  // namespace palpate::spline_sdf
