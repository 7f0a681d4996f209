// A hand that is told where to go while it goes: by a mouse, by a program. The goal follows what it is told
// smoothly, for a mouse speaks far less often than a servo ticks.
#pragma once

#include <algorithm>

#include "device/simulated/hand_script.h"
#include "toolkit/core/handover.h"

namespace palpate::device {

class HandGuide {
 public:
  /// The goal lags by so long: two reports of a mouse (60 to 125 a second).
  static constexpr double kFollowS = 0.03;
  /// No faster than a hand that explores; device frame.
  static constexpr double kFastestMmS = 250.0;
  /// A longer time between two questions is a pause, not a motion.
  static constexpr double kLongestS = 0.05;

  /// Device frame. Who tells it more often than a mouse does may let it follow faster.
  explicit HandGuide(const Vec3& start_mm, double follow_s = kFollowS)
      : aim_(start_mm), at_mm_(start_mm), follow_s_(follow_s) {}

  /// One thread: where the hand is to go, device frame. Wait-free.
  void aim(const Vec3& goal_mm) noexcept { aim_.publish(goal_mm); }

  /// One other thread, the simulated device's: the goal at `t_s`, which may only begin anew at 0. Wait-free,
  /// no allocation.
  [[nodiscard]] Goal at(double t_s) noexcept {
    (void)aim_.acquire();
    const double dt_s = std::clamp(t_s - last_s_, 0.0, kLongestS);
    last_s_ = t_s;
    if (!is_finite(aim_.front())) return {at_mm_, Vec3::Zero()};
    // Backward Euler of a first-order lag: stable for any step.
    const Vec3 way_mm = aim_.front() - at_mm_;
    Vec3 velocity_mm_s = way_mm / (follow_s_ + dt_s);
    const double speed = velocity_mm_s.norm();
    if (speed > kFastestMmS) velocity_mm_s *= kFastestMmS / speed;
    at_mm_ += dt_s * velocity_mm_s;
    return {at_mm_, velocity_mm_s};
  }

 private:
  Handover<Vec3> aim_;
  Vec3 at_mm_;
  double follow_s_;
  double last_s_ = 0.0;
};

}  // namespace palpate::device
