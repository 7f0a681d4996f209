// Forward kinematics of open arms with three motors, in closed form, with the Jacobian: a chain of three
// joints (WoodenHaptics, Polhem v1, the aluminium edition), and the five-bar linkage of Polhem v2 and v3.
//
// Angles in rad, all measured in the frame of the base: A turns the arm about z; B tilts the upper arm from
// the vertical (chain) or is the crank's angle (five-bar); C likewise of the forearm. Lengths mm.
// Source: the makers' published kinematics; derived anew here.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "toolkit/core/vec.h"

namespace palpate::device {

enum class ArmLinkage : std::uint8_t { kChain, kFiveBar };

struct ArmGeometry {
  ArmLinkage linkage = ArmLinkage::kChain;
  /// Chain: L_a (height of the shoulder), L_b, L_c. Five-bar: L0 (between the cranks), L1 (crank B), L2
  /// (crank C), L3 (rod), L4 (from the elbow back to the rod), L5 (forearm).
  std::array<double, 6> lengths_mm{};
  Vec3 origin_mm = Vec3::Zero();  ///< of the device frame, in the base's
};

using ArmAngles = std::array<double, 3>;

struct ArmPose {
  Vec3 position_mm = Vec3::Zero();
  Mat3 mm_per_rad = Mat3::Zero();  ///< column i: what angle i alone moves
};

/// Nothing where the linkage cannot be put together so, or only in its other form: then there is no force to
/// show. A few dozen operations.
[[nodiscard]] std::optional<ArmPose> arm_pose(const ArmGeometry& geometry, const ArmAngles& angles) noexcept;

/// Torques about A, B, C that show a force: N*mm for N. By virtual work, the transposed Jacobian.
[[nodiscard]] inline Vec3 torques_n_mm(const ArmPose& pose, const Vec3& force_n) noexcept {
  return pose.mm_per_rad.transpose() * force_n;
}

/// Masses of a chain's bodies and where their centres are, from each body's own joint.
struct ArmMasses {
  double upper_kg = 0.0, upper_mm = 0.0;
  double fore_kg = 0.0, fore_mm = 0.0;
};
/// Torques about A, B, C that hold the chain against its weight, N*mm. Zero for a five-bar.
[[nodiscard]] Vec3 weight_torques_n_mm(const ArmGeometry& geometry, const ArmMasses& masses,
                                       const ArmAngles& angles) noexcept;

/// An upper estimate of the smallest step in mm that steps of the three angles (rad) make together.
[[nodiscard]] double arm_resolution_mm(const ArmGeometry& geometry,
                                       const std::array<double, 3>& step_rad) noexcept;

}  // namespace palpate::device
