// The exact answer on surfaces known by formula: ground truth.
//
// A constrained god object (Zilles and Salisbury 1995) in double: free until the HIP's segment enters the
// surface, then the local minimum of the distance to the HIP, tracked along the surface from the entry, until
// the HIP is back outside as seen from there. The HIP's motion is sub-stepped within a frame, so that the
// answer is the converged one. It is never timed. Several models: each keeps its own god object, forces add
// up; the god object, model and normal reported are those of the model with the largest force.
#pragma once

#include <vector>

#include "toolkit/render/model_pose.h"
#include "toolkit/render/registry.h"
#include "toolkit/render/renderer.h"

namespace palpate::render {

class AnalyticRenderer final : public HapticRenderer {
 public:
  /// Fails when a model has no formula.
  [[nodiscard]] Result<PrepareReport> prepare(const SceneInput& scene,
                                              const PrepareContext& context) override;
  void reset(const Vec3& hip_mm) noexcept override;
  [[nodiscard]] Frame step(const Vec3& hip_mm, double dt_s) noexcept override;
  [[nodiscard]] FrameCounters counters() const noexcept override { return counters_; }
  [[nodiscard]] Description describe() const override;

  /// Outward unit normal at the god object of the last frame, world frame; (0, 0, 1) when it was free.
  [[nodiscard]] const Vec3& normal() const noexcept { return normal_; }

 private:
  struct Model {
    std::shared_ptr<const geometry::AnalyticSurface> surface;
    ModelPose pose;
    double stiffness_n_per_mm = 0.0;
    double sub_step_mm = 0.0;
    // State, model frame.
    bool touching = false;
    geometry::SurfacePoint god_object;
    Vec3 reached_mm = Vec3::Zero();  ///< where the HIP's motion has been followed to
  };
  /// Follows the HIP's motion to `hip_mm` (model frame); false when a bound stopped it on the way.
  static bool follow(Model& model, const Vec3& hip_mm, FrameCounters& counters) noexcept;
  /// Tracks in contact; false when it was released, `reached_mm` then tells where.
  static bool stay_in_contact(Model& model, const Vec3& hip_mm, FrameCounters& counters) noexcept;

  std::vector<Model> models_;
  double force_limit_n_ = 0.0;
  double now_s_ = 0.0;
  bool started_ = false;
  FrameCounters counters_;
  Vec3 normal_ = Vec3::UnitZ();
};

/// The registry's entry.
[[nodiscard]] RendererInfo analytic_renderer_info();

}  // namespace palpate::render
