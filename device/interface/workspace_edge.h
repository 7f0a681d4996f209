// Fades forces near the edge of a device's workspace, so that an arm never meets its stop at full torque.
#pragma once

#include <palpate/device/device.h>

namespace palpate::device {

/// Returns `force_n` (device frame, at `position_mm`) with its outward part faded: from full at `share` of
/// the way from edge to middle, to none at the edge and beyond. Inward and tangential parts stay. A damper of
/// `damping_n_s_per_mm`, growing over the same range, acts against outward velocity only.
///
/// Continuously differentiable in the position. The gain depends on the position alone, so a force that does
/// too gives back on the way in exactly what it took on the way out along the normal; the damper only
/// dissipates. Lengths are shares of the workspace's half extents. A box has a wall per axis, an ellipsoid
/// one, a cylinder its mantle and ends. O(1), no allocation.
[[nodiscard]] Vec3 faded_at_edge(const DeviceLimits& limits, double share, double damping_n_s_per_mm,
                                 const Vec3& position_mm, const Vec3& velocity_mm_s,
                                 const Vec3& force_n) noexcept;

/// 3 t^2 - 2 t^3 of t clamped to [0, 1]; slope 0 at both ends.
[[nodiscard]] double smooth_step(double t) noexcept;

}  // namespace palpate::device
