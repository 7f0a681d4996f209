#include "experiments/window/mouse_hand.h"

#include <algorithm>
#include <cmath>

namespace palpate::experiments {

void MouseHand::wheel(double steps) noexcept {
  press_mm_ = std::clamp(press_mm_ * std::pow(kWheelFactor, steps), kLeastPressMm, kMostPressMm);
}

std::optional<Vec3> MouseHand::goal_mm(const std::optional<Hit>& hit, const Vec3& ray_place_mm,
                                       const Camera& camera, const device::DeviceMap& map, bool pressed) {
  if (hit) last_ = hit;
  if (!last_) return std::nullopt;
  const double factor = map.world_per_device;
  const Vec3 towards_eye = -camera.forward();
  if (!hit) return Vec3(ray_place_mm + kHoverMm * factor * towards_eye);
  const Vec3 outward = hit->normal.norm() > 0.0 ? hit->normal : towards_eye;
  return Vec3(hit->place_mm + (pressed ? -press_mm_ : kHoverMm) * factor * outward);
}

}  // namespace palpate::experiments
