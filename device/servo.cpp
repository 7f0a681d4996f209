#include "device/servo.h"

#include <utility>

namespace palpate::device {

Status Servo::start() {
  if (Status opened = device_.open(); !opened) return opened;
  rearm();
  return Done{};
}

void Servo::rearm() noexcept {
  placed_ = false;
  governor_.arm(clock_.now_s());
}

void Servo::stop() noexcept {
  governor_.disarm();
  device_.send(governor_.zero());
  device_.close();
}

Tick Servo::tick() noexcept {
  Tick tick;
  tick.t_s = clock_.now_s();
  tick.state = device_.read();
  Vec3 wanted_n = Vec3::Zero();
  const bool usable = tick.state.status != ReadStatus::kLost && is_finite(tick.state.position_mm);
  if (governor_.armed() && usable) {
    const Vec3 hip_mm = world_from_device_ * tick.state.position_mm;
    if (!placed_) {
      renderer_.reset(hip_mm);
      placed_ = true;
      last_s_ = tick.t_s - governor_.options().period_s;
    }
    tick.frame = renderer_.step(hip_mm, tick.t_s - last_s_);
    last_s_ = tick.t_s;
    wanted_n = world_from_device_.inverse().rotate(tick.frame.force_n);
  }
  GovernedForce governed = governor_.govern(tick.t_s, tick.state, wanted_n);
  tick.sent_n = governed.newtons();
  tick.fault = governor_.fault();
  device_.send(std::move(governed));
  return tick;
}

}  // namespace palpate::device
