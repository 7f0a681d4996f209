// Renderers around those of a study.
#pragma once

#include <memory>
#include <utility>

#include "toolkit/render/renderer.h"
#include "toolkit/render/scene_free_renderer.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments::psychophysics {

/// Free space everywhere. It is felt between two intervals, so that a switch from a thing to itself takes the
/// same way, and the same time, as one to another thing. A frame does nothing.
class Nothing final : public render::SceneFreeRenderer {
 public:
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double /*t_s*/) noexcept override {
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    return frame;
  }
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
class HeldRate final : public render::WrappedRenderer {
 public:
  HeldRate(std::unique_ptr<render::HapticRenderer> inner, double rate_hz) noexcept
      : WrappedRenderer(std::move(inner)), period_s_(1.0 / rate_hz) {}
  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    due_s_ = t_s;
    inner().restart(hip_mm, t_s);
  }
  void let_go(const Vec3& hip_mm) noexcept override {
    due_s_ = 0.0;
    inner().let_go(hip_mm);
  }
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override;

 private:
  double period_s_;
  double due_s_ = 0.0;
  render::Frame held_;
};

}  // namespace palpate::experiments::psychophysics
