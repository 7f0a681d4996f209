// The direction in which points vary least: the normal of their least-squares plane.
#pragma once

#include "toolkit/core/tolerances.h"
#include "toolkit/core/vec.h"

namespace palpate::surface {

/// Points lie on a line, as far as rounding can tell, when the middle eigenvalue is below this share of the
/// largest: coordinates are floats, so a true line's points stray by 2^-24 of their distance, the square of
/// it in eigenvalues; a thousand times that leaves room for the solver's own error.
inline constexpr double kLineShare = 1000.0 * kUnitRoundoffFloat * kUnitRoundoffFloat;

/// Squarings of the adjugate: each squares the ratio of its second eigenvalue to its first, so five leave
/// less than 1e-9 of any other direction where the two smallest eigenvalues differ by half.
inline constexpr int kSquarings = 5;

/// A symmetric 3 x 3 matrix.
struct Symmetric {
  double xx = 0.0, xy = 0.0, xz = 0.0, yy = 0.0, yz = 0.0, zz = 0.0;
  /// weight d dᵀ.
  void add(const Vec3& d, double weight = 1.0) noexcept {
    xx += weight * d.x() * d.x();
    xy += weight * d.x() * d.y();
    xz += weight * d.x() * d.z();
    yy += weight * d.y() * d.y();
    yz += weight * d.y() * d.z();
    zz += weight * d.z() * d.z();
  }
  /// Less share d dᵀ: of sums over n offsets that add up to d their covariance, n times, where share = 1 / n.
  [[nodiscard]] Symmetric without(const Vec3& d, double share) const noexcept {
    return {xx - share * d.x() * d.x(), xy - share * d.x() * d.y(), xz - share * d.x() * d.z(),
            yy - share * d.y() * d.y(), yz - share * d.y() * d.z(), zz - share * d.z() * d.z()};
  }
  [[nodiscard]] double trace() const noexcept { return xx + yy + zz; }
  [[nodiscard]] Symmetric scaled(double s) const noexcept {
    return {xx * s, xy * s, xz * s, yy * s, yz * s, zz * s};
  }
  [[nodiscard]] Symmetric adjugate() const noexcept {
    return {yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy,
            xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy};
  }
  [[nodiscard]] Symmetric squared() const noexcept {
    return {xx * xx + xy * xy + xz * xz, xx * xy + xy * yy + xz * yz, xx * xz + xy * yz + xz * zz,
            xy * xy + yy * yy + yz * yz, xy * xz + yy * yz + yz * zz, xz * xz + yz * yz + zz * zz};
  }
};

/// The unit direction that a symmetric matrix projects onto: its longest column. False where it is not
/// finite.
[[nodiscard]] inline bool longest_column(const Symmetric& projector, Vec3& direction) noexcept {
  const Symmetric& p = projector;
  if (p.xx >= p.yy && p.xx >= p.zz)
    direction = Vec3(p.xx, p.xy, p.xz);
  else if (p.yy >= p.zz)
    direction = Vec3(p.xy, p.yy, p.yz);
  else
    direction = Vec3(p.xz, p.yz, p.zz);
  direction.normalize();
  return is_finite(direction);
}

/// The eigenvector of the smallest eigenvalue of a covariance; false where the points lie on a line or at one
/// place. The adjugate has the same eigenvectors and the products of the other two eigenvalues, the largest
/// for the smallest; its high powers are that eigenvector's projector. Only sums and products, so that every
/// compiler and library gives the same bits.
[[nodiscard]] inline bool least_direction(const Symmetric& covariance, Vec3& direction) noexcept {
  const double size = covariance.trace();
  if (!(size > 0.0)) return false;
  Symmetric power = covariance.scaled(1.0 / size).adjugate();
  double trace = power.trace();
  // Of eigenvalues that sum to 1: about the middle one.
  if (!(trace > kLineShare)) return false;
  for (int i = 0; i < kSquarings; ++i) {
    power = power.scaled(1.0 / trace).squared();
    trace = power.trace();
  }
  return longest_column(power, direction);
}

}  // namespace palpate::surface
