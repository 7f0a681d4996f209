// A spring of known stiffness under a simulated hand.
#pragma once

#include "device/simulated/closed_loop.h"
#include "device/simulated/simulated_arm.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::device {

/// A plane z = 0 with a spring. Pushes only, or, bilateral, pulls too: a linear loop.
class SpringPlane final : public render::SceneFreeRenderer {
 public:
  explicit SpringPlane(double stiffness, bool bilateral = false)
      : stiffness_n_per_mm(stiffness), bilateral_(bilateral) {}
  void restart(const Vec3& hip_mm, double) noexcept override { before_mm_ = hip_mm.z(); }
  render::Frame step(const Vec3& hip_mm, double) noexcept override {
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    if (bilateral_ || hip_mm.z() < 0.0) {
      frame.contact = true;
      frame.god_object_mm.z() = 0.0;
      frame.force_n.z() = -stiffness_n_per_mm * hip_mm.z() - difference_n_per_mm * (hip_mm.z() - before_mm_);
    }
    before_mm_ = hip_mm.z();
    return frame;
  }
  render::Description describe() const override { return {"spring", "", "", "constant", {}}; }

  double stiffness_n_per_mm;
  double difference_n_per_mm = 0.0;  ///< B / T of a wall with damping

 private:
  bool bilateral_;
  double before_mm_ = 0.0;
};

/// No slew limit to speak of, no soft start: what theory is about.
inline LoopOptions bare_loop(double period_s, double duration_s) {
  LoopOptions options;
  options.period_s = period_s;
  options.duration_s = duration_s;
  options.slew_n_per_s = 1e12;
  options.soft_start_s = 1e-9;
  return options;
}

/// From 1 mm above to 2 mm below z = 0 within 0.05 s.
inline HandScript press_script() {
  return HandScript::create("press", {0.0, 0.05}, {Vec3{0.0, 0.0, 1.0}, Vec3{0.0, 0.0, -2.0}},
                            HandScript::Between::kMinimumJerk)
      .value();
}

/// From one place to another at one speed.
inline HandScript straight(const Vec3& from_mm, const Vec3& to_mm, double seconds = 1.0) {
  return HandScript::create("straight", {0.0, seconds}, {from_mm, to_mm}, HandScript::Between::kStraight)
      .value();
}

inline HandScript resting_at(const Vec3& place_mm) {
  return HandScript::create("rest", {0.0}, {place_mm}, HandScript::Between::kStraight).value();
}

}  // namespace palpate::device
