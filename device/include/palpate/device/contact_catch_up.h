// Brings up a renderer under a hand, even in contact. It releases the renderer at a place known to be free
// and steps it from there to the HIP, a bounded number of steps a tick. The result equals that of a renderer
// that never released, unless the way crosses something else.
//
// First:
//   palpate::render::ContactCatchUp catch_up;  // for a loop of your own; Servo has one
//   catch_up.begin(*renderer, free_mm, clock.now_s());
//   while (catch_up.pending()) (void)catch_up.advance(*renderer, hip_mm, next_tick_s());
#pragma once

#include <algorithm>
#include <cmath>

#include <palpate/renderer.h>

namespace palpate::render {

struct ContactCatchUpOptions {
  double step_mm = 0.5;     ///< a hand at 0.5 m/s in a 1 ms frame: every renderer can follow
  int steps_per_tick = 16;  ///< renderer frames per tick: 16 of 10 us leave most of 1 ms
};

/// For the frame thread only. Allocates nothing.
class ContactCatchUp {
 public:
  explicit ContactCatchUp(const ContactCatchUpOptions& options = {}) noexcept : options_(options) {}

  void begin(HapticRenderer& renderer, const Vec3& free_mm, double t_s) noexcept {
    renderer.release_contact(free_mm);
    at_mm_ = free_mm;
    last_s_ = t_s;
    pending_ = true;
  }
  /// True while on the way: no force may be given yet.
  [[nodiscard]] bool pending() const noexcept { return pending_; }
  void abandon() noexcept { pending_ = false; }

  /// A tick at `t_s`, later than the last: takes steps towards `hip_mm` up to the bound and returns the last
  /// answer.
  [[nodiscard]] Frame advance(HapticRenderer& renderer, const Vec3& hip_mm, double t_s) noexcept {
    const Vec3 from = at_mm_, way = hip_mm - from;
    const double needed = std::max(1.0, std::ceil(way.norm() / options_.step_mm));
    const int steps =
        static_cast<int>(std::min(needed, static_cast<double>(std::max(1, options_.steps_per_tick))));
    Frame frame;
    for (int i = 1; i <= steps; ++i) {
      at_mm_ = i < needed ? Vec3(from + (i / needed) * way) : hip_mm;
      frame = renderer.step(at_mm_, last_s_ + (t_s - last_s_) * i / steps);
    }
    last_s_ = t_s;
    pending_ = steps < needed;
    return frame;
  }

 private:
  ContactCatchUpOptions options_;
  Vec3 at_mm_ = Vec3::Zero();
  double last_s_ = 0.0;
  bool pending_ = false;
};

}  // namespace palpate::render
