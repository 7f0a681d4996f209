// The project's vector types. Fixed size; nothing here allocates.
//
// First:
//   const palpate::Vec3 hip_mm(0.0, 0.0, 12.5);
//   if (!palpate::is_finite(hip_mm)) return;
//   const double from_origin_mm = hip_mm.norm();
#pragma once

#include <Eigen/Core>

#include <cmath>

namespace palpate {

/// A point or a vector in double precision. Positions in mm, forces in N; names say which.
using Vec3 = Eigen::Vector3d;
/// A stored point: float, relative to a local origin.
using Vec3f = Eigen::Vector3f;
using Mat3 = Eigen::Matrix3d;

[[nodiscard]] inline bool is_finite(const Vec3& v) noexcept {
  return std::isfinite(v.x()) && std::isfinite(v.y()) && std::isfinite(v.z());
}

/// The length, without overflow or underflow of squared components.
[[nodiscard]] inline double stable_norm(const Vec3& v) noexcept {
  // Between these bounds, well inside 1e-308 to 1e308, no squared component that matters was lost.
  constexpr double kLeast = 1e-250, kMost = 1e250;
  const double square = v.squaredNorm();
  return square > kLeast && square < kMost ? std::sqrt(square) : v.stableNorm();
}

}  // namespace palpate
