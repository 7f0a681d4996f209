// The vector types of the whole project. Fixed size only: nothing here allocates.
#pragma once

#include <Eigen/Core>

#include <cmath>

namespace palpate {

/// A point or a vector in double precision. Positions in mm, forces in N; names say which.
using Vec3 = Eigen::Vector3d;
/// A stored point: float, relative to some local origin.
using Vec3f = Eigen::Vector3f;
using Mat3 = Eigen::Matrix3d;

[[nodiscard]] inline bool is_finite(const Vec3& v) noexcept {
  return std::isfinite(v.x()) && std::isfinite(v.y()) && std::isfinite(v.z());
}

/// The length, right also where the square of a component would overflow or vanish.
[[nodiscard]] inline double safe_length(const Vec3& v) noexcept {
  // Far enough inside the doubles (1e-308 to 1e308) that no square of a component that counts was lost.
  constexpr double kLeast = 1e-250, kMost = 1e250;
  const double square = v.squaredNorm();
  return square > kLeast && square < kMost ? std::sqrt(square) : v.stableNorm();
}

}  // namespace palpate
