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

}  // namespace palpate
