// What the scores ask the true surface, beyond the reference trace.
#pragma once

#include "toolkit/core/result.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/analytic_surface.h"
#include "toolkit/geometry/rigid_transform.h"
#include "toolkit/trace/trace.h"

namespace palpate::metrics {

/// The true surface in the WORLD frame, mm. Not on the frame path: implementations may allocate and take
/// their time. Safe to call from several threads.
class TruthSurface {
 public:
  TruthSurface() = default;
  TruthSurface(const TruthSurface&) = delete;
  TruthSurface& operator=(const TruthSurface&) = delete;
  virtual ~TruthSurface() = default;

  /// Distance to the surface, negative inside.
  [[nodiscard]] virtual double signed_distance_mm(const Vec3& p_mm) const = 0;
  /// The closest point of the whole surface and its outward normal.
  [[nodiscard]] virtual geometry::SurfacePoint closest(const Vec3& p_mm) const = 0;
};

/// A formula with a pose. Keeps a reference to the surface.
class AnalyticTruth final : public TruthSurface {
 public:
  AnalyticTruth(const geometry::AnalyticSurface& surface, const geometry::RigidTransform& world_from_model)
      : surface_(surface),
        world_from_model_(world_from_model),
        model_from_world_(world_from_model.inverse()) {}

  [[nodiscard]] double signed_distance_mm(const Vec3& p_mm) const override {
    return surface_.signed_distance_mm(model_from_world_ * p_mm);
  }
  [[nodiscard]] geometry::SurfacePoint closest(const Vec3& p_mm) const override {
    const geometry::SurfacePoint found = surface_.closest(model_from_world_ * p_mm);
    return {world_from_model_ * found.point_mm, world_from_model_.rotate(found.normal)};
  }

 private:
  const geometry::AnalyticSurface& surface_;
  geometry::RigidTransform world_from_model_;
  geometry::RigidTransform model_from_world_;
};

/// An Error (file = the path's name, line 2 = the first sample of a CSV file) where the path starts inside.
[[nodiscard]] Status check_starts_free(const trace::ProbePath& path, const TruthSurface& truth);

}  // namespace palpate::metrics
