// Where the scene stands in a device's workspace, and the clutch that moves it there.
#pragma once

#include <cstdint>

#include "device/interface/device.h"
#include "device/servo/device_map.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/aabb.h"

namespace palpate::device {

enum class WorkspaceFit : std::uint8_t {
  kOneToOne,  ///< a mm is a mm; what is larger than the workspace is reached by the clutch
  kFitted,    ///< the scene's box just fits into nine tenths of the workspace
  kFactor,    ///< by a number
};

struct WorkspaceOptions {
  WorkspaceFit fit = WorkspaceFit::kOneToOne;
  double factor = 1.0;  ///< of kFactor: mm of the scene for a mm of the device
};

/// The middle of the scene's box in the middle of the workspace, unturned. Errors: a factor that is not
/// finite and above 0, a box or a workspace without extent where they are to fit.
[[nodiscard]] Result<DeviceMap> map_for(const geometry::Aabb& scene_mm, const DeviceLimits& limits,
                                        const WorkspaceOptions& options);

/// Of the workspace's box, what lies in its shape whatever the direction: the half lengths of the largest box
/// of the same proportions that the shape holds.
[[nodiscard]] Vec3 reachable_half_mm(const DeviceLimits& limits) noexcept;

/// The clutch, as one lifts a mouse: while it is held the HIP rests and the device goes where the hand likes;
/// when it is let go the scene has moved along with the hand. It engages in free space alone, where a HIP
/// that rests feels nothing, so that no force ever depends on it. The servo's thread, between ticks.
class Clutch {
 public:
  /// The map to use from the next tick on. `free`: the last frame had neither contact nor force. `device_mm`:
  /// where the device was in it, finite.
  [[nodiscard]] DeviceMap update(const DeviceMap& now, bool pressed, bool free,
                                 const Vec3& device_mm) noexcept;
  [[nodiscard]] bool engaged() const noexcept { return engaged_; }

 private:
  bool engaged_ = false;
  DeviceMap before_;
  Vec3 held_mm_ = Vec3::Zero();
};

}  // namespace palpate::device
