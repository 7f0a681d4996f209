// The exact answer on analytic surfaces: ground truth.
//
// A constrained god object (Zilles and Salisbury 1995) in double precision. It is free until the HIP's
// segment enters the surface, then at the local minimum of the distance to the HIP, tracked along the
// surface, until the HIP is outside again as seen from there. The motion is sub-stepped within a frame, so
// the answer is converged. It is never timed. Several touched models hold the god object together
// (frame_loop.h); the frame reports the model of the largest force.
#pragma once

#include <memory>

#include <palpate/registry.h>
#include "toolkit/render/frame_loop_renderer.h"

namespace palpate::render {

/// The local model of the frame loop.
class AnalyticModel {
 public:
  using Memory = geometry::SurfacePoint;
  AnalyticModel(const ModelInput& input, double sub_step_mm);

  [[nodiscard]] ModelPose& pose() noexcept { return pose_; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return pose_; }
  void release_contact(const Vec3& h) noexcept;
  void release() noexcept {}
  [[nodiscard]] bool touch(const Vec3& goal, const Vec3& h, Memory& memory, SurfaceContact& contact,
                           FrameStatus& status, FrameCounters& counters) noexcept;
  [[nodiscard]] SurfaceResponse respond(const SurfaceContact& contact) const noexcept;
  void planes_near(const Memory& memory, const Vec3& at_world, JointPlanes& planes,
                   FrameCounters& counters) const noexcept;

 private:
  /// Follows the HIP's motion to `h`; false if a bound stopped it.
  bool follow(const Vec3& h, FrameCounters& counters) noexcept;
  /// Tracks in contact; false on release, at reached_.
  bool stay_in_contact(const Vec3& h, FrameCounters& counters) noexcept;

  std::shared_ptr<const geometry::AnalyticSurface> surface_;
  ModelPose pose_;
  double stiffness_n_per_mm_;
  double sub_step_mm_;
  bool touching_ = false;
  bool started_ = false;
  geometry::SurfacePoint god_object_;
  Vec3 reached_ = Vec3::Zero();  ///< the HIP's motion is followed up to here
};

class AnalyticRenderer final : public FrameLoopRenderer<AnalyticModel> {
 public:
  AnalyticRenderer() : FrameLoopRenderer({}) {}
  [[nodiscard]] Description describe() const override;

 private:
  /// Fails when the model has no formula.
  Result<ModelDecisions> decide_model(const ModelInput& input, const PrepareContext& context) const override;
  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override;
};

/// The registry entry.
[[nodiscard]] RendererInfo analytic_renderer_info();

}  // namespace palpate::render
