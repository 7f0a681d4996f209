// Bringing a renderer up under a hand that may be in contact already: it lets go at a place known to be free
// and follows small steps from there to the HIP, a bounded number of them a tick. What it then answers is
// what a renderer answers that never let go, where the way there crosses nothing else.
#pragma once

#include <algorithm>
#include <cmath>

#include "toolkit/render/renderer.h"

namespace palpate::render {

struct BringUpOptions {
  double step_mm = 0.5;     ///< as a hand at 0.5 m/s goes in a frame of 1 ms: every renderer follows that
  int steps_per_tick = 16;  ///< frames of the renderer in one tick: 16 of 10 us leave most of 1 ms
};

/// One thread, that of the frames. Nothing is allocated.
class BringUp {
 public:
  explicit BringUp(const BringUpOptions& options = {}) noexcept : options_(options) {}

  void begin(HapticRenderer& renderer, const Vec3& free_mm, double t_s) noexcept {
    renderer.let_go(free_mm);
    at_mm_ = free_mm;
    last_s_ = t_s;
    pending_ = true;
  }
  /// Still on the way: no force may be given yet.
  [[nodiscard]] bool pending() const noexcept { return pending_; }
  void abandon() noexcept { pending_ = false; }

  /// A tick at `t_s`, later than the last: as many steps towards `hip_mm` as one may take; the last one's
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
  BringUpOptions options_;
  Vec3 at_mm_ = Vec3::Zero();
  double last_s_ = 0.0;
  bool pending_ = false;
};

}  // namespace palpate::render
