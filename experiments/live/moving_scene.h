// A renderer wrapper that moves the scene's models.
#pragma once

#include <memory>
#include <utility>

#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments {

/// Moves the models to the time of each step before it. Owns the renderer; refers to the simulation, which
/// nothing else may advance.
class MovingScene final : public render::WrappedRenderer {
 public:
  MovingScene(std::unique_ptr<render::HapticRenderer> inner, render::Simulation& simulation)
      : WrappedRenderer(std::move(inner)), simulation_(simulation) {}

  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    simulation_.reset();
    simulation_.advance(t_s);
    inner().restart(hip_mm, t_s);
  }
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    simulation_.advance(t_s);
    return inner().step(hip_mm, t_s);
  }

 private:
  render::Simulation& simulation_;
};

}  // namespace palpate::experiments
