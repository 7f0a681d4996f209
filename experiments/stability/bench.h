// A renderer on the simulated device: what one run is made of, and what is asked of it.
#pragma once

#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "device/simulated/closed_loop.h"
#include "device/simulated/simulated_admittance.h"
#include "device/simulated/simulated_arm.h"
#include "experiments/run/stage.h"
#include "toolkit/control/controlled_renderer.h"
#include "toolkit/render/scene_free_renderer.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments {

/// The renderer's force times a gain, so that one preparation serves every stiffness. Refers to it.
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

/// The truth as a renderer: a spring to the closest point of the true surface. Refers to it. The last answer
/// is kept: encoders hold a HIP at one place for many ticks.
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
  Vec3 last_hip_mm_ = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());  // equal to none
  render::Frame last_;
};

inline constexpr double kMillisecondsPerS = 1e3;

/// The device and the hand of a run.
struct Bench {
  std::optional<device::ArmOptions> arm;  ///< or the admittance device
  device::Hand hand;
  double rate_hz = 1000.0, delay_s = 0.0, jitter_s = 0.0;
  double slew_n_per_s = 1000.0;
  [[nodiscard]] double period_s() const { return 1.0 / rate_hz; }
  [[nodiscard]] std::string device_name() const;
};

/// "omni", .., "admittance" and a hand by name. Errors list the names.
[[nodiscard]] Result<Bench> bench_of(const std::string& device, const std::string& hand);

/// How long a run lasts, and after how long at rest its end is known; 0: it is simulated all the same.
struct RunLength {
  double duration_s = 0.0, still_s = 0.0;
};

/// Runs the script, which is in coordinates about `origin_mm` of the world.
[[nodiscard]] Result<device::LoopRun> run_on(const Bench& bench, const device::HandScript& script,
                                             render::HapticRenderer& renderer, const Vec3& origin_mm,
                                             const RunLength& length);

/// Where tasks are done; world frame.
struct Places {
  device::TaskPlace flat;  ///< where the truth's contact is
  bool has_edge = false;   ///< the normal turns within a few mm somewhere
  device::TaskPlace edge;  ///< where it turns most
  device::TaskSizes sizes;
};
/// Errors: the stage has no truth, or its path never touches it.
[[nodiscard]] Result<Places> places_on(const Stage& stage);

}  // namespace palpate::experiments
