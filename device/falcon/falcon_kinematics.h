// The Falcon's arm: a delta robot of three legs, each a driven thigh and a parallelogram for a shin. Position
// to leg angles in closed form, back by Newton's method, and the Jacobian that turns force into torque.
//
// Frame of this file: mm, right-handed, from the middle of the base: x right, y up, z towards the user. The
// symbols are those of R. E. Stamper's thesis (University of Maryland 1997, PhD 97-4, p. 30). No length here
// was measured on a device; all are published.
#pragma once

#include <array>
#include <optional>

#include "toolkit/core/vec.h"

namespace palpate::device {

/// Where the legs' counters are near 0 and all legs bend alike: the middle of the workspace.
inline constexpr double kFalconCentreMm = 130.0;

/// Angle of each thigh in rad for a position; nothing where a leg cannot reach it. O(1).
[[nodiscard]] std::optional<Vec3> falcon_angles(const Vec3& position_mm) noexcept;

/// A with dθ = A dp, rad/mm, for a position and its angles. Nothing at a singular pose.
[[nodiscard]] std::optional<Mat3> falcon_jacobian(const Vec3& position_mm, const Vec3& angles_rad) noexcept;

/// Torques about the thighs' axes, N mm, that hold a force in N at the grip: A^-T F. Nothing where A has no
/// inverse.
[[nodiscard]] std::optional<Vec3> falcon_torques(const Mat3& jacobian, const Vec3& force_n) noexcept;

struct FalconPose {
  Vec3 position_mm = Vec3(0.0, 0.0, kFalconCentreMm);
  int steps = 0;           ///< Newton steps taken
  bool converged = false;  ///< else no position has these angles, or none was found
};
/// The most steps that falcon_position takes, each with at most kFalconHalvings halvings.
inline constexpr int kFalconNewtonSteps = 24, kFalconHalvings = 12;
/// The position whose angles these are, sought from `start_mm`, which must be in reach. Bounded, no
/// allocation.
[[nodiscard]] FalconPose falcon_position(const Vec3& angles_rad, const Vec3& start_mm) noexcept;

/// Leg angles of encoder counts, which may be fractions here. 35 degrees at 0.
[[nodiscard]] Vec3 falcon_angles_of_counts(const Vec3& counts) noexcept;
[[nodiscard]] Vec3 falcon_counts_of_angles(const Vec3& angles_rad) noexcept;

}  // namespace palpate::device
