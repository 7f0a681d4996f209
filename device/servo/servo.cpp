#include "device/servo/servo.h"

#include <utility>

#include "toolkit/core/try.h"

namespace palpate::device {

Status Servo::start(const std::optional<Vec3>& free_mm) {
  PALPATE_TRY(device_.open());
  last_free_mm_ = free_mm;
  // A period before the first tick: the bring-up goes on from there.
  if (free_mm) renderer_.restart(*free_mm, clock_.now_s() - governor_.options().period_s);
  rearm();
  return Done{};
}

void Servo::rearm() noexcept {
  placed_ = false;
  rearmed_ = true;
  bring_up_.abandon();
  governor_.arm(clock_.now_s());
}

void Servo::stop() noexcept {
  governor_.disarm();
  device_.send(governor_.zero());
  device_.close();
}

/// The first good position after arming. True where the renderer was restarted.
bool Servo::place(const Vec3& hip_mm, double t_s) noexcept {
  placed_ = true;
  const double before_s = t_s - governor_.options().period_s;
  if (last_free_mm_) {
    bring_up_.begin(renderer_, *last_free_mm_, before_s);
    return false;
  }
  renderer_.restart(hip_mm, before_s);
  governor_.arm(clock_.now_s());  // what the restart took is no lateness
  return true;
}

Tick Servo::tick() noexcept {
  Tick tick;
  tick.t_ns = clock_.now_ns();
  tick.t_s = clock_.now_s();
  tick.rearmed = std::exchange(rearmed_, false);
  tick.state = device_.read();
  const std::int64_t read_ns = clock_.now_ns();
  Vec3 wanted_n = Vec3::Zero();
  const bool usable = tick.state.status != ReadStatus::kLost && is_finite(tick.state.position_mm);
  if (governor_.armed() && usable) {
    const Vec3 hip_mm = map_.world_mm(tick.state.position_mm);
    tick.hip_mm = hip_mm;
    if (!placed_) tick.restarted = place(hip_mm, tick.t_s);
    if (bring_up_.pending()) {
      tick.frame = bring_up_.advance(renderer_, hip_mm, tick.t_s);
    } else {
      tick.frame = renderer_.step(hip_mm, tick.t_s);
    }
    if (bring_up_.pending())
      tick.frame.force_n.setZero();  // of a place on the way
    else if (!tick.frame.contact)
      last_free_mm_ = hip_mm;
    wanted_n = map_.device_n(tick.frame.force_n);
    tick.step_ns = clock_.now_ns() - read_ns;
  }
  GovernedForce governed = governor_.govern(tick.t_s, tick.state, wanted_n);
  tick.sent_n = governed.newtons();
  tick.fault = governor_.fault();
  const std::int64_t send_ns = clock_.now_ns();
  device_.send(std::move(governed));
  tick.exchange_ns = (read_ns - tick.t_ns) + (clock_.now_ns() - send_ns);
  return tick;
}

}  // namespace palpate::device
