// Renderers for tests of the mixer: planes with a spring, of a height, and what they may do wrong.
#pragma once

#include <limits>

#include <palpate/clock.h>
#include "device/live/mixer.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::device {

/// The half space below z = height, a spring.
class HighPlane final : public render::SceneFreeRenderer {
 public:
  HighPlane(double stiffness, double height) : stiffness_n_per_mm(stiffness), height_mm(height) {}
  ~HighPlane() override {
    if (destroyed != nullptr) ++*destroyed;
  }
  void restart(const Vec3& hip_mm, double) noexcept override {
    ++restarts;
    new_points_mm = hip_mm;
  }
  void release_contact(const Vec3& hip_mm) noexcept override {
    ++lettings_go;
    new_points_mm = hip_mm;
  }
  render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    ++steps;
    if (t_s < last_s) ++back_in_time;
    last_s = t_s;
    if (clock != nullptr) clock->advance(takes_s);
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    if (hip_mm.z() < height_mm) {
      frame.contact = true;
      frame.model = 0;
      frame.god_object_mm.z() = height_mm;
      frame.force_n.z() = stiffness_n_per_mm * (height_mm - hip_mm.z());
    }
    if (broken) frame.force_n.setConstant(std::numeric_limits<double>::quiet_NaN());
    return frame;
  }
  render::FrameCounters counters() const noexcept override {
    render::FrameCounters counters;
    counters.frames = static_cast<std::uint64_t>(steps);
    return counters;
  }
  render::Description describe() const override { return {"plane", "", "", "constant", {}}; }

  double stiffness_n_per_mm, height_mm;
  bool broken = false;
  VirtualClock* clock = nullptr;  ///< goes on by takes_s in every step
  double takes_s = 0.0;
  int* destroyed = nullptr;
  int restarts = 0, lettings_go = 0, steps = 0, back_in_time = 0;
  double last_s = -1.0;
  Vec3 new_points_mm = Vec3::Zero();
};

/// A mixer of two planes on a virtual clock, stepped by hand.
struct TwoPlanes {
  explicit TwoPlanes(const SwitchOptions& options, double second_n_per_mm = 0.8, double second_mm = 0.0)
      : mixer(options, clock) {
    auto first = std::make_unique<HighPlane>(0.5, 0.0);
    auto second = std::make_unique<HighPlane>(second_n_per_mm, second_mm);
    a = first.get();
    b = second.get();
    mixer.add(std::move(first));
    mixer.add(std::move(second));
  }
  void begin(double z_mm) { mixer.restart(Vec3(0.0, 0.0, z_mm), t_s); }
  render::Frame step(double z_mm, double x_mm = 0.0) {
    t_s += 1e-3;
    clock.advance_to(std::llround(t_s * 1e9));
    return mixer.step(Vec3(x_mm, 0.0, z_mm), t_s);
  }
  /// So many frames at one place; the last one's answer.
  render::Frame rest(double z_mm, int frames) {
    render::Frame frame;
    for (int i = 0; i < frames; ++i) frame = step(z_mm);
    return frame;
  }
  /// Begins a millimetre above, and is at a height for so many frames.
  void come(double z_mm, int frames, int above = 3) {
    begin(1.0);
    rest(1.0, above);
    rest(z_mm, frames);
  }
  /// Asks for a lane, and steps once.
  render::Frame ask_at(double z_mm, std::uint8_t lane) {
    ask(lane);
    return step(z_mm);
  }
  void ask(std::uint8_t lane) { mixer.request({SwitchRequest::Kind::kSelect, SwitchSource::kProgram, lane}); }
  [[nodiscard]] std::uint8_t felt() const { return mixer.last().tracked[mixer.last().felt].lane; }

  VirtualClock clock;
  Mixer mixer;
  HighPlane* a = nullptr;
  HighPlane* b = nullptr;
  double t_s = 0.0;
};

inline SwitchOptions bench_options(SwitchRule rule = SwitchRule::kContactElseWait) {
  return {.rule = rule, .device_force_max_n = 3.3, .force_limit_n = 3.3};
}

}  // namespace palpate::device
