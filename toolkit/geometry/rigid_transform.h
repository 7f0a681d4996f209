// Rotation and translation, named a_from_b: p_a = a_from_b * p_b.
#pragma once

#include <Eigen/Geometry>

#include "toolkit/core/vec.h"

namespace palpate::geometry {

/// A rigid motion; identity by default. Right-handed axes, mm.
struct RigidTransform {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< unit
  Vec3 translation_mm = Vec3::Zero();

  [[nodiscard]] Vec3 operator*(const Vec3& p_mm) const noexcept { return rotation * p_mm + translation_mm; }
  [[nodiscard]] Vec3 rotate(const Vec3& v) const noexcept { return rotation * v; }
  [[nodiscard]] RigidTransform inverse() const noexcept {
    const Eigen::Quaterniond back = rotation.conjugate();
    return {back, -(back * translation_mm)};
  }
  [[nodiscard]] bool is_identity() const noexcept {
    return translation_mm == Vec3::Zero() && rotation.w() == 1.0 && rotation.vec() == Vec3::Zero();
  }
};

}  // namespace palpate::geometry
