// The exact answer on surfaces known by formula: ground truth.
//
// A constrained god object (Zilles and Salisbury 1995) in double: free until the HIP's segment enters the
// surface, then the local minimum of the distance to the HIP, tracked along the surface from the entry, until
// the HIP is back outside as seen from there. The HIP's motion is sub-stepped within a frame, so that the
// answer is the converged one. It is never timed. Several models touched at once hold the god object together
// (see frame_shell.h); the model reported is that of the largest force.
#pragma once

#include <memory>

#include "toolkit/render/registry.h"
#include "toolkit/render/shell_renderer.h"

namespace palpate::render {

/// The local model of the frame shell.
class AnalyticModel {
 public:
  using Memory = geometry::SurfacePoint;
  AnalyticModel(const ModelInput& input, double sub_step_mm);

  [[nodiscard]] ModelPose& pose() noexcept { return pose_; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return pose_; }
  void let_go(const Vec3& h) noexcept;
  void release() noexcept {}
  [[nodiscard]] bool touch(const Vec3& goal, const Vec3& h, Memory& memory, SurfaceContact& contact,
                           FrameStatus& status, FrameCounters& counters) noexcept;
  [[nodiscard]] SurfaceAnswer respond(const SurfaceContact& contact) const noexcept;
  void planes_near(const Memory& memory, const Vec3& at_world, JointPlanes& planes,
                   FrameCounters& counters) const noexcept;

 private:
  /// Follows the HIP's motion to `h`; false when a bound stopped it on the way.
  bool follow(const Vec3& h, FrameCounters& counters) noexcept;
  /// Tracks in contact; false when it was released, reached_ then tells where.
  bool stay_in_contact(const Vec3& h, FrameCounters& counters) noexcept;

  std::shared_ptr<const geometry::AnalyticSurface> surface_;
  ModelPose pose_;
  double stiffness_n_per_mm_;
  double sub_step_mm_;
  bool touching_ = false;
  bool started_ = false;
  geometry::SurfacePoint god_object_;
  Vec3 reached_ = Vec3::Zero();  ///< where the HIP's motion has been followed to
};

class AnalyticRenderer final : public ShellRenderer<AnalyticModel> {
 public:
  AnalyticRenderer() : ShellRenderer({}) {}
  [[nodiscard]] Description describe() const override;

 private:
  /// Fails when the model has no formula.
  Result<ModelDecisions> decide_model(const ModelInput& input, const PrepareContext& context) const override;
  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override;
};

/// The registry's entry.
[[nodiscard]] RendererInfo analytic_renderer_info();

}  // namespace palpate::render
