// The true force along a path: the constrained god object of an analytic surface, tracked to convergence.
//
// First:
//   const auto& m = scene.models[0];
//   auto truth = palpate::metrics::analytic_reference(*m.analytic, path, m.surface.stiffness_n_per_mm,
//                                                     scene.force_limit_n, m.world_from_model);
//   if (!truth) return failed(truth.error());
//   std::puts(truth->exactness.c_str());
#pragma once

#include <palpate/analytic_surface.h>
#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include <palpate/vec.h>

namespace palpate::search {
struct NeighbourTable;  // toolkit/search/neighbour_table.h
}

namespace palpate::metrics {

/// The true surface in the WORLD frame, mm. Thread-safe. Not for frames: implementations may allocate and be
/// slow.
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

/// An analytic surface with a pose. Keeps a reference to the surface.
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

/// An Error if the path starts inside (file = the path's name, line 2 = the first sample of a CSV file).
[[nodiscard]] Status check_starts_free(const trace::ProbePath& path, const TruthSurface& truth);

struct ReferenceOptions {
  int sub_steps = 8;  ///< pieces into which the HIP's way of one frame is divided
  bool check_halving =
      true;  ///< track again with twice as many pieces and state the difference of the god object
};

/// Tracks the god object along `path`. It is free until a piece enters the surface, then at the local minimum
/// of distance reached along the surface (never changing sheets), until the HIP is outside again. Force =
/// stiffness x (god object - HIP), limited to force_limit_n (0 = none). A path that starts inside is an Error
/// with its line. local_resolution_mm stays 0 (see fill_local_resolution). `exactness` states the checks with
/// numbers. O(frames x sub_steps) closest-point searches; never timed.
[[nodiscard]] Result<trace::ReferenceTrace> analytic_reference(
    const geometry::AnalyticSurface& surface, const trace::ProbePath& path, double stiffness_n_per_mm,
    double force_limit_n, const geometry::RigidTransform& world_from_model,
    const ReferenceOptions& options = {});

/// Sets local_resolution_mm of every frame: the distance from the cloud point nearest to the true god object
/// (when free: to the nearest surface point, h - d n) to its last neighbour in `neighbours`, usually its
/// eighth. Differing sizes are an Error. O(points + frames) for clouds of bounded density variation.
[[nodiscard]] Status fill_local_resolution(trace::ReferenceTrace& reference, const trace::ProbePath& path,
                                           const cloud::Cloud& cloud,
                                           const search::NeighbourTable& neighbours,
                                           const geometry::RigidTransform& world_from_model);
/// The same, finding the eight nearest neighbours of every point with `threads` threads.
[[nodiscard]] Status fill_local_resolution(trace::ReferenceTrace& reference, const trace::ProbePath& path,
                                           const cloud::Cloud& cloud,
                                           const geometry::RigidTransform& world_from_model, int threads);

}  // namespace palpate::metrics
