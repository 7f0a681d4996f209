// The least renderer to control: an elastic wall, matter below z = 0, made wrong in known ways.
#pragma once

#include "toolkit/render/renderer.h"

namespace palpate::control {

class Wall final : public render::HapticRenderer {
 public:
  double stiffness_n_per_mm = 0.5;
  double out_stiffness_n_per_mm = 0.5;  ///< on the way out: more than on the way in is energy from nowhere
  double limit_n = -1.0;                ///< as prepare() saw it

  [[nodiscard]] Result<render::Decisions> decide(const render::SceneInput& scene,
                                                 const render::PrepareContext& /*context*/) const override {
    render::Decisions decided;
    decided.decisions.push_back(render::force_limit_decision(scene.force_limit_n));
    return decided;
  }
  [[nodiscard]] Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                                      const render::PrepareContext& /*context*/) override {
    limit_n = scene.force_limit_n;
    render::PrepareReport report;
    report.bytes = 1;
    report.decisions = decide(scene, {}).value();
    return report;
  }
  void restart(const Vec3& hip_mm, double /*t_s*/) noexcept override {
    let_go(hip_mm);
    counters_ = {};
  }
  void let_go(const Vec3& hip_mm) noexcept override { last_z_mm_ = hip_mm.z(); }
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double /*t_s*/) noexcept override {
    ++counters_.frames;
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    if (!is_finite(hip_mm)) {
      frame.status = render::FrameStatus::kNonFinite;
      return frame;
    }
    if (hip_mm.z() < 0.0) {
      frame.contact = true;
      frame.model = 0;
      frame.god_object_mm.z() = 0.0;
      const double k = hip_mm.z() > last_z_mm_ ? out_stiffness_n_per_mm : stiffness_n_per_mm;
      frame.force_n = render::limited(Vec3(0, 0, -k * hip_mm.z()), limit_n);
    }
    last_z_mm_ = hip_mm.z();
    return frame;
  }
  [[nodiscard]] render::FrameCounters counters() const noexcept override { return counters_; }
  [[nodiscard]] render::Description describe() const override {
    return {"wall", "a wall", "here", "none", {}};
  }

 private:
  double last_z_mm_ = 0.0;
  render::FrameCounters counters_;
};

}  // namespace palpate::control
