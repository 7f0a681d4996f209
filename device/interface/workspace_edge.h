// What a device's workspace does to a force near its edge: an arm must never meet its stop at full torque.
#pragma once

#include "device/interface/device.h"

namespace palpate::device {

/// `force_n` (device frame, at `position_mm`) without what would push the device out of its workspace: that
/// part fades from all of it, `share` of the way from the edge to the middle, to none at the edge and beyond.
/// What pushes inward, or along the edge, stays. Besides, a damper of `damping_n_s_per_mm` that grows over
/// the same way acts against a velocity that leads out; never against one that leads in.
///
/// Continuous, with a continuous slope in the position. The gain depends on the position alone: a force that
/// does so too gives back over a way out and in, along the normal, exactly what it took, and the damper only
/// takes. Lengths are shares of the workspace's half extents, so nothing here is absolute. By shape: a box
/// has a wall along each axis, an ellipsoid one, a cylinder its mantle and its ends. O(1), no allocation.
[[nodiscard]] Vec3 faded_at_edge(const DeviceLimits& limits, double share, double damping_n_s_per_mm,
                                 const Vec3& position_mm, const Vec3& velocity_mm_s,
                                 const Vec3& force_n) noexcept;

/// 3 t^2 - 2 t^3 of t held to [0, 1]: 0 and 1 at its ends, with no slope there.
[[nodiscard]] double smooth_step(double t) noexcept;

}  // namespace palpate::device
