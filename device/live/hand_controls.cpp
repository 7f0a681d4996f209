#include "device/live/hand_controls.h"

#include <cmath>
#include <numbers>
#include <string>

namespace palpate::device {
namespace {

// Share of the workspace; the rest is for moving around the scene, and for the weak edge.
constexpr double kFilledShare = 0.9;

}  // namespace

Vec3 reachable_half_mm(const DeviceLimits& limits) noexcept {
  const Vec3 half = 0.5 * limits.workspace_mm.extent_mm();
  switch (limits.workspace_shape) {
    case WorkspaceShape::kBox:
      return half;
    case WorkspaceShape::kEllipsoid:  // (x/a)^2 + (y/b)^2 + (z/c)^2 = 1 at x/a = y/b = z/c
      return std::numbers::inv_sqrt3 * half;
    case WorkspaceShape::kCylinder:
      return {half.x() / std::numbers::sqrt2, half.y() / std::numbers::sqrt2, half.z()};
  }
  return half;
}

Result<DeviceMap> map_for(const geometry::Aabb& scene_mm, const DeviceLimits& limits,
                          const WorkspaceOptions& options) {
  double factor = options.fit == WorkspaceFit::kFactor ? options.factor : 1.0;
  if (options.fit == WorkspaceFit::kFitted) {
    const Vec3 reach = 2.0 * kFilledShare * reachable_half_mm(limits), extent = scene_mm.extent_mm();
    factor = (extent.array() / reach.array()).maxCoeff();
    if (!std::isfinite(factor) || !(factor > 0.0))
      return Error{"the scene or the workspace has no extent", "name the factor instead of fitting"};
  }
  if (!std::isfinite(factor) || !(factor > 0.0))
    return Error{"the factor of the workspace is " + std::to_string(factor), "give a finite number above 0"};
  geometry::RigidTransform world_from_device;
  world_from_device.translation_mm = scene_mm.centre_mm() - factor * limits.workspace_mm.centre_mm();
  return DeviceMap(world_from_device, factor);
}

DeviceMap Clutch::update(const DeviceMap& now, bool pressed, bool free, const Vec3& device_mm) noexcept {
  if (pressed == engaged_ || (pressed && !free)) return now;
  engaged_ = pressed;
  if (engaged_) {
    before_ = now;
    held_mm_ = now.world_mm(device_mm);
    DeviceMap held = now;
    held.world_per_device = 0.0;
    held.world_from_device.translation_mm = held_mm_;
    return held;
  }
  DeviceMap after = before_;
  after.world_from_device.translation_mm += held_mm_ - before_.world_mm(device_mm);
  return after;
}

void SwitchButton::took(const Tick& tick) noexcept {
  const bool pressed = button_.update((tick.state.buttons & options_.switch_mask) != 0, tick.t_s);
  if (pressed && !was_pressed_) {
    pressed_s_ = tick.t_s;
    const MixedFrame& now = mixer_.last();
    lane_before_ = now.felt == MixedFrame::kNobody ? std::uint8_t{0} : now.tracked[now.felt].lane;
    asks_ = true;
    asks_at_s_ = tick.t_s + options_.decide_after_s;
    request_ = {SwitchRequest::Kind::kNext, SwitchSource::kButton, 0};
  } else if (!pressed && was_pressed_ && tick.t_s - pressed_s_ > options_.momentary_s) {
    asks_ = true;
    asks_at_s_ = tick.t_s + options_.decide_after_s;
    request_ = {SwitchRequest::Kind::kSelect, SwitchSource::kButton, lane_before_};
  }
  was_pressed_ = pressed;
  if (!asks_ || tick.t_s < asks_at_s_) return;
  asks_ = false;
  mixer_.request(request_);
}

void ClutchButton::took(const Tick& tick) noexcept {
  const bool pressed = button_.update((tick.state.buttons & options_.clutch_mask) != 0, tick.t_s);
  // Without a valid frame the scene stays.
  if (tick.fault != Fault::kNone || !is_finite(tick.state.position_mm)) return;
  bool free = tick.frame.force_n == Vec3::Zero() && mixer_.last().state != MixState::kFading;
  for (const TrackedFrame& one : mixer_.last().tracked) free = free && (!one.present || !one.frame.contact);
  servo_.remap(clutch_.update(servo_.map(), pressed, free, tick.state.position_mm));
}

}  // namespace palpate::device
