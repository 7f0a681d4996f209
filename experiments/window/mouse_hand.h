// The mouse as a hand: its goal hovers over the surface under the cursor and presses into it while the button
// is held. Device, servo and governor produce the force as for any hand.
#pragma once

#include <optional>

#include <palpate/device/device_map.h>
#include "experiments/window/camera.h"
#include "experiments/window/splats.h"

namespace palpate::experiments {

class MouseHand {
 public:
  /// In device mm, like scripted tasks' (TaskSizes), independent of the scene's size.
  static constexpr double kHoverMm = 2.0, kFirstPressMm = 4.0, kLeastPressMm = 0.5, kMostPressMm = 20.0;
  static constexpr double kWheelFactor = 1.15;

  /// The goal, world frame; empty until the cursor has once been over the surface. Off the surface it hovers
  /// in the picture plane through the last place. `hit`: under the cursor.
  [[nodiscard]] std::optional<Vec3> goal_mm(const std::optional<Hit>& hit, const Vec3& ray_place_mm,
                                            const Camera& camera, const device::DeviceMap& map, bool pressed);
  /// Wheel steps while the button is held: change the depth.
  void wheel(double steps) noexcept;
  [[nodiscard]] double press_mm() const noexcept { return press_mm_; }
  /// The last place under the cursor, world frame.
  [[nodiscard]] const std::optional<Hit>& last() const noexcept { return last_; }
  void forget() noexcept { last_.reset(); }

 private:
  double press_mm_ = kFirstPressMm;
  std::optional<Hit> last_;
};

}  // namespace palpate::experiments
