// A renderer whose scene moves: whoever steps it needs not know.
#pragma once

#include <memory>
#include <utility>

#include "toolkit/render/renderer.h"

namespace palpate::experiments {

/// Moves the scene's models to the time of each step before it. Owns the renderer, refers to the simulation,
/// which nobody else may advance.
class MovingScene final : public render::HapticRenderer {
 public:
  MovingScene(std::unique_ptr<render::HapticRenderer> inner, render::Simulation& simulation)
      : inner_(std::move(inner)), simulation_(simulation) {}

  [[nodiscard]] Result<render::Decisions> decide(const render::SceneInput& scene,
                                                 const render::PrepareContext& context) const override {
    return inner_->decide(scene, context);
  }
  [[nodiscard]] Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                                      const render::PrepareContext& context) override {
    return inner_->prepare(scene, context);
  }
  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    simulation_.reset();
    simulation_.advance(t_s);
    inner_->restart(hip_mm, t_s);
  }
  void let_go(const Vec3& hip_mm) noexcept override { inner_->let_go(hip_mm); }
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    simulation_.advance(t_s);
    return inner_->step(hip_mm, t_s);
  }
  [[nodiscard]] render::FrameCounters counters() const noexcept override { return inner_->counters(); }
  [[nodiscard]] render::Description describe() const override { return inner_->describe(); }

 private:
  std::unique_ptr<render::HapticRenderer> inner_;
  render::Simulation& simulation_;
};

}  // namespace palpate::experiments
