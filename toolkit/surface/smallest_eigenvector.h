// The direction of least variance of points: the normal of their least-squares plane.
#pragma once

#include <palpate/vec.h>
#include "toolkit/core/tolerances.h"

namespace palpate::surface {

/// Points count as collinear when the middle eigenvalue is below this share of the largest. Float coordinates
/// stray from a true line by 2^-24 of their distance, squared in eigenvalues; the factor 1000 covers the
/// solver's error.
inline constexpr double kCollinearRatio = 1000.0 * kUnitRoundoffFloat * kUnitRoundoffFloat;

/// Squarings of the adjugate. Each squares the ratio of the second eigenvalue to the first, so five leave
/// less than 1e-9 of other directions where the two smallest eigenvalues differ by half.
inline constexpr int kSquarings = 5;

/// A symmetric 3 x 3 matrix.
struct SymmetricMatrix3 {
  double xx = 0.0, xy = 0.0, xz = 0.0, yy = 0.0, yz = 0.0, zz = 0.0;
  /// Adds weight d dᵀ.
  void add(const Vec3& d, double weight = 1.0) noexcept {
    xx += weight * d.x() * d.x();
    xy += weight * d.x() * d.y();
    xz += weight * d.x() * d.z();
    yy += weight * d.y() * d.y();
    yz += weight * d.y() * d.z();
    zz += weight * d.z() * d.z();
  }
  /// Subtracts share d dᵀ. Applied to sums over n offsets with total d and share = 1 / n, it gives n times
  /// their covariance.
  [[nodiscard]] SymmetricMatrix3 without(const Vec3& d, double share) const noexcept {
    return {xx - share * d.x() * d.x(), xy - share * d.x() * d.y(), xz - share * d.x() * d.z(),
            yy - share * d.y() * d.y(), yz - share * d.y() * d.z(), zz - share * d.z() * d.z()};
  }
  [[nodiscard]] double trace() const noexcept { return xx + yy + zz; }
  [[nodiscard]] SymmetricMatrix3 scaled(double s) const noexcept {
    return {xx * s, xy * s, xz * s, yy * s, yz * s, zz * s};
  }
  [[nodiscard]] SymmetricMatrix3 adjugate() const noexcept {
    return {yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy,
            xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy};
  }
  [[nodiscard]] SymmetricMatrix3 squared() const noexcept {
    return {xx * xx + xy * xy + xz * xz, xx * xy + xy * yy + xz * yz, xx * xz + xy * yz + xz * zz,
            xy * xy + yy * yy + yz * yz, xy * xz + yy * yz + yz * zz, xz * xz + yz * yz + zz * zz};
  }
};

/// The unit direction that a projection matrix projects onto: its longest column. False if not finite.
[[nodiscard]] inline bool longest_column(const SymmetricMatrix3& projector, Vec3& direction) noexcept {
  const SymmetricMatrix3& p = projector;
  if (p.xx >= p.yy && p.xx >= p.zz)
    direction = Vec3(p.xx, p.xy, p.xz);
  else if (p.yy >= p.zz)
    direction = Vec3(p.xy, p.yy, p.yz);
  else
    direction = Vec3(p.xz, p.yz, p.zz);
  direction.normalize();
  return is_finite(direction);
}

/// The eigenvector of a covariance's smallest eigenvalue; false if the points are collinear or coincident.
/// The adjugate has the same eigenvectors with products of the other two eigenvalues, largest for the
/// smallest; its high powers approach that eigenvector's projector. Uses sums and products only, so every
/// compiler gives the same bits.
[[nodiscard]] inline bool smallest_eigenvector(const SymmetricMatrix3& covariance, Vec3& direction) noexcept {
  const double size = covariance.trace();
  if (!(size > 0.0)) return false;
  SymmetricMatrix3 power = covariance.scaled(1.0 / size).adjugate();
  double trace = power.trace();
  // With eigenvalues that sum to 1, this is about the middle one.
  if (!(trace > kCollinearRatio)) return false;
  for (int i = 0; i < kSquarings; ++i) {
    power = power.scaled(1.0 / trace).squared();
    trace = power.trace();
  }
  return longest_column(power, direction);
}

}  // namespace palpate::surface
