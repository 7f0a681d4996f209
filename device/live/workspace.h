// Places the scene in a device's workspace; the clutch moves it.
#pragma once

#include <cstdint>

#include <palpate/aabb.h>
#include <palpate/device/device.h>
#include <palpate/device/device_map.h>
#include <palpate/result.h>

namespace palpate::device {

enum class WorkspaceFit : std::uint8_t {
  kOneToOne,  ///< a mm is a mm; the clutch reaches what is larger than the workspace
  kFitted,    ///< the scene's box fits nine tenths of the workspace
  kFactor,    ///< by a number
};

struct WorkspaceOptions {
  WorkspaceFit fit = WorkspaceFit::kOneToOne;
  double factor = 1.0;  ///< for kFactor: mm of the scene for a mm of the device
};

/// Centres the scene's box in the workspace, unrotated. Errors: a factor that is not finite and above 0; to
/// fit, a box or workspace without extent.
[[nodiscard]] Result<DeviceMap> map_for(const geometry::Aabb& scene_mm, const DeviceLimits& limits,
                                        const WorkspaceOptions& options);

/// Half lengths of the largest box, of the workspace box's proportions, inside its shape.
[[nodiscard]] Vec3 reachable_half_mm(const DeviceLimits& limits) noexcept;

/// The clutch, like lifting a mouse: while held the HIP rests and the device moves freely; on release the
/// scene has moved with the hand. Engages only in free space, where a resting HIP feels nothing, so no force
/// depends on it. Servo thread, between ticks.
class Clutch {
 public:
  /// The map for the next ticks. `free`: the last frame had neither contact nor force. `device_mm`: the
  /// device's position in it, finite.
  [[nodiscard]] DeviceMap update(const DeviceMap& now, bool pressed, bool free,
                                 const Vec3& device_mm) noexcept;
  [[nodiscard]] bool engaged() const noexcept { return engaged_; }

 private:
  bool engaged_ = false;
  DeviceMap before_;
  Vec3 held_mm_ = Vec3::Zero();
};

}  // namespace palpate::device
