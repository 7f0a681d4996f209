#include "device/live/triggers.h"

namespace palpate::device {

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
