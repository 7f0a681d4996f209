// A renderer with a clock of its own, and what moves its scene: tests step it by hand, in steps of time.
#pragma once

#include <memory>
#include <utility>

#include <palpate/renderer.h>

namespace palpate::test {

/// Reads as a pointer to a renderer whose frames take a step of time instead of a time.
class Stepped {
 public:
  class Stepper {
   public:
    explicit Stepper(std::unique_ptr<render::HapticRenderer> renderer) : renderer_(std::move(renderer)) {}
    /// From now on the scene moves with the frames.
    void drive(std::shared_ptr<render::Simulation> simulation) { simulation_ = std::move(simulation); }

    [[nodiscard]] Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                                        const render::PrepareContext& context) {
      return renderer_->prepare(scene, context);
    }
    void restart(const Vec3& hip_mm) noexcept {
      t_s_ = 0.0;
      if (simulation_ != nullptr) simulation_->reset();
      renderer_->restart(hip_mm, t_s_);
    }
    void release_contact(const Vec3& hip_mm) noexcept { renderer_->release_contact(hip_mm); }
    [[nodiscard]] render::Frame step(const Vec3& hip_mm, double dt_s) noexcept {
      t_s_ += dt_s;
      if (simulation_ != nullptr) simulation_->advance(t_s_);
      return renderer_->step(hip_mm, t_s_);
    }
    [[nodiscard]] render::FrameCounters counters() const noexcept { return renderer_->counters(); }
    [[nodiscard]] render::Description describe() const { return renderer_->describe(); }

   private:
    friend class Stepped;
    std::unique_ptr<render::HapticRenderer> renderer_;
    std::shared_ptr<render::Simulation> simulation_;
    double t_s_ = 0.0;
  };

  Stepped() = default;
  // NOLINTNEXTLINE: implicit, so that a renderer just made can be stepped
  Stepped(std::unique_ptr<render::HapticRenderer> renderer)
      : stepper_(std::make_unique<Stepper>(std::move(renderer))) {}

  [[nodiscard]] Stepper* operator->() const noexcept { return stepper_.get(); }
  [[nodiscard]] render::HapticRenderer& operator*() const noexcept { return *stepper_->renderer_; }
  [[nodiscard]] render::HapticRenderer* get() const noexcept { return stepper_->renderer_.get(); }

 private:
  std::unique_ptr<Stepper> stepper_;
};

}  // namespace palpate::test
