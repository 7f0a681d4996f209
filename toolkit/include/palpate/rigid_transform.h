// Rotation and translation, named a_from_b: p_a = a_from_b * p_b.
//
// First:
//   palpate::geometry::RigidTransform world_from_model;
//   world_from_model.translation_mm = {0.0, 0.0, 50.0};
//   const Vec3 in_world_mm = world_from_model * Vec3(1.0, 2.0, 3.0);
//   const Vec3 back_mm = world_from_model.inverse() * in_world_mm;
#pragma once

#include <Eigen/Geometry>

#include <palpate/vec.h>

namespace palpate::geometry {

/// A rigid motion, mm; identity by default. Right-handed axes.
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
