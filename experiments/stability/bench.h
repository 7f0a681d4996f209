// Test bench: a renderer on the simulated device.
#pragma once

#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <palpate/control.h>
#include "device/simulated/closed_loop.h"
#include "device/simulated/simulated_arm.h"
#include "experiments/run/stage.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments {

/// Scales the renderer's force by a gain, so one preparation serves every stiffness. Refers to it.
class GainRenderer final : public render::WrappedRenderer {
 public:
  GainRenderer(render::HapticRenderer& inner, double gain) : WrappedRenderer(inner), gain_(gain) {}
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    render::Frame frame = inner().step(hip_mm, t_s);
    frame.force_n *= gain_;
    return frame;
  }

 private:
  double gain_;
};

/// The truth as a renderer: a spring to the closest point of the true surface. Refers to it. Caches the last
/// answer, since encoders hold a HIP in place for many ticks.
class TruthRenderer final : public render::SceneFreeRenderer {
 public:
  TruthRenderer(const metrics::TruthSurface& truth, double stiffness_n_per_mm)
      : truth_(truth), stiffness_n_per_mm_(stiffness_n_per_mm) {}
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override;
  [[nodiscard]] render::Description describe() const override {
    return {"truth", "the true surface", "", "that of a closest point", {}};
  }

 private:
  [[nodiscard]] render::Frame answer(const Vec3& hip_mm) const noexcept;
  const metrics::TruthSurface& truth_;
  double stiffness_n_per_mm_;
  Vec3 last_hip_mm_ = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());  // NaN equals no position
  render::Frame last_;
};

inline constexpr double kMillisecondsPerS = 1e3;

/// A run's device and hand.
struct Bench {
  std::optional<device::ArmOptions> arm;  ///< or the admittance device
  device::Hand hand;
  double rate_hz = 1000.0, delay_s = 0.0, jitter_s = 0.0;
  double slew_n_per_s = 1000.0;
  [[nodiscard]] double period_s() const { return 1.0 / rate_hz; }
};

/// Device "omni", .., "admittance", and a hand by name. Errors list the names.
[[nodiscard]] Result<Bench> bench_of(const std::string& device, const std::string& hand);

/// A run's duration, and the time at rest after which it ends early; 0: never.
struct RunLength {
  double duration_s = 0.0, still_s = 0.0;
};

/// Runs the script, whose coordinates are relative to `origin_mm`, world frame.
[[nodiscard]] Result<device::LoopRun> run_on(const Bench& bench, const device::HandScript& script,
                                             render::HapticRenderer& renderer, const Vec3& origin_mm,
                                             const RunLength& length);

/// Places for tasks; world frame.
struct Places {
  device::TaskPlace flat;  ///< at the truth's contact
  bool has_edge = false;   ///< the normal turns within a few mm somewhere
  device::TaskPlace edge;  ///< where it turns most
  device::TaskSizes sizes;
};
/// Errors: no truth, or a path without contact.
[[nodiscard]] Result<Places> places_on(const Stage& stage);

}  // namespace palpate::experiments
