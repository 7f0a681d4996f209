// A renderer together with the simulation of its scene, both on the time of the frames: what replays and
// tests run where a live system has two threads.
#pragma once

#include <memory>
#include <utility>

#include "toolkit/render/motion.h"
#include "toolkit/render/renderer.h"

namespace palpate::render {

class OnVirtualClock final : public HapticRenderer {
 public:
  OnVirtualClock(std::unique_ptr<HapticRenderer> renderer, std::shared_ptr<Simulation> simulation)
      : renderer_(std::move(renderer)), simulation_(std::move(simulation)) {}

  [[nodiscard]] Result<PrepareReport> prepare(const SceneInput& scene,
                                              const PrepareContext& context) override {
    return renderer_->prepare(scene, context);
  }
  void reset(const Vec3& hip_mm) noexcept override {
    now_s_ = 0.0;
    simulation_->reset();
    renderer_->reset(hip_mm);
  }
  [[nodiscard]] Frame step(const Vec3& hip_mm, double dt_s) noexcept override {
    now_s_ += dt_s;
    simulation_->advance(now_s_);
    return renderer_->step(hip_mm, dt_s);
  }
  [[nodiscard]] FrameCounters counters() const noexcept override { return renderer_->counters(); }
  [[nodiscard]] Description describe() const override { return renderer_->describe(); }

 private:
  std::unique_ptr<HapticRenderer> renderer_;
  std::shared_ptr<Simulation> simulation_;
  double now_s_ = 0.0;
};

}  // namespace palpate::render
