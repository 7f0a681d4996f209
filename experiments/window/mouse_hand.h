// The mouse as a hand: the goal of the simulated hand stands over the surface under the cursor, and goes into
// it while the button is held. What is felt comes out of device, servo and governor as for any hand.
#pragma once

#include <optional>

#include "device/servo/device_map.h"
#include "experiments/window/camera.h"
#include "experiments/window/splats.h"

namespace palpate::experiments {

class MouseHand {
 public:
  /// Of the device, as those of scripted tasks are (TaskSizes): a hand's lengths, whatever the scene's.
  static constexpr double kHoverMm = 2.0, kFirstPressMm = 4.0, kLeastPressMm = 0.5, kMostPressMm = 20.0;
  /// One step of the wheel.
  static constexpr double kWheelFactor = 1.15;

  /// Where the goal is to be, world frame; nothing until the cursor has been over the surface once. Off the
  /// surface it hovers in the plane of the picture through the last place. `hit`: under the cursor.
  [[nodiscard]] std::optional<Vec3> goal_mm(const std::optional<Hit>& hit, const Vec3& ray_place_mm,
                                            const Camera& camera, const device::DeviceMap& map, bool pressed);
  /// Steps of the wheel while the button is held: deeper, or less deep.
  void wheel(double steps) noexcept;
  [[nodiscard]] double press_mm() const noexcept { return press_mm_; }
  /// The place of the world that was last under the cursor.
  [[nodiscard]] const std::optional<Hit>& last() const noexcept { return last_; }
  void forget() noexcept { last_.reset(); }

 private:
  double press_mm_ = kFirstPressMm;
  std::optional<Hit> last_;
};

}  // namespace palpate::experiments
