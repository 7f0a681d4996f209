// Renderers around those of a study.
#pragma once

#include <memory>
#include <utility>

#include "toolkit/render/renderer.h"

namespace palpate::experiments::psychophysics {

/// Free space everywhere. It is felt between two intervals, so that a switch from a thing to itself takes the
/// same way, and the same time, as one to another thing. A frame does nothing.
class Nothing final : public render::HapticRenderer {
 public:
  [[nodiscard]] Result<render::Decisions> decide(const render::SceneInput& /*scene*/,
                                                 const render::PrepareContext& /*context*/) const override {
    return render::Decisions{};
  }
  [[nodiscard]] Result<render::PrepareReport> prepare(const render::SceneInput& /*scene*/,
                                                      const render::PrepareContext& /*context*/) override {
    return render::PrepareReport{};
  }
  void restart(const Vec3& /*hip_mm*/, double /*t_s*/) noexcept override {}
  void let_go(const Vec3& /*hip_mm*/) noexcept override {}
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double /*t_s*/) noexcept override {
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    return frame;
  }
  [[nodiscard]] render::FrameCounters counters() const noexcept override { return {}; }
  [[nodiscard]] render::Description describe() const override {
    render::Description description;
    description.name = "nothing";
    description.summary = "free space";
    description.work_bound = "nothing";
    return description;
  }
};

/// Asks the renderer so often a second, and holds its answer in between: an update rate below that of the
/// servo. A frame costs what the renderer's does, or nothing.
class HeldRate final : public render::HapticRenderer {
 public:
  HeldRate(std::unique_ptr<render::HapticRenderer> inner, double rate_hz) noexcept
      : inner_(std::move(inner)), period_s_(1.0 / rate_hz) {}
  [[nodiscard]] Result<render::Decisions> decide(const render::SceneInput& scene,
                                                 const render::PrepareContext& context) const override {
    return inner_->decide(scene, context);
  }
  [[nodiscard]] Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                                      const render::PrepareContext& context) override {
    return inner_->prepare(scene, context);
  }
  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    due_s_ = t_s;
    inner_->restart(hip_mm, t_s);
  }
  void let_go(const Vec3& hip_mm) noexcept override {
    due_s_ = 0.0;
    inner_->let_go(hip_mm);
  }
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override;
  [[nodiscard]] render::FrameCounters counters() const noexcept override { return inner_->counters(); }
  [[nodiscard]] render::Description describe() const override { return inner_->describe(); }

 private:
  std::unique_ptr<render::HapticRenderer> inner_;
  double period_s_;
  double due_s_ = 0.0;
  render::Frame held_;
};

}  // namespace palpate::experiments::psychophysics
