// Wrappers and stand-ins for the renderers of a study.
#pragma once

#include <memory>
#include <utility>

#include <palpate/renderer.h>
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments::psychophysics {

/// Free space everywhere, felt between two intervals. It makes switching a renderer to itself take the same
/// steps and time as switching to another. A frame does nothing.
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

/// Updates the renderer at a lower rate than the servo and holds its answer in between. A frame costs the
/// renderer's time or nothing.
class HeldRate final : public render::WrappedRenderer {
 public:
  HeldRate(std::unique_ptr<render::HapticRenderer> inner, double rate_hz) noexcept
      : WrappedRenderer(std::move(inner)), period_s_(1.0 / rate_hz) {}
  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    due_s_ = t_s;
    inner().restart(hip_mm, t_s);
  }
  void release_contact(const Vec3& hip_mm) noexcept override {
    due_s_ = 0.0;
    inner().release_contact(hip_mm);
  }
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override;

 private:
  double period_s_;
  double due_s_ = 0.0;
  render::Frame held_;
};

}  // namespace palpate::experiments::psychophysics
